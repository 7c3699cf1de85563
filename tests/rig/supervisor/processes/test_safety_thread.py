"""The safety thread names whoever fails, and does without it what the failed part cannot."""

import dataclasses
import errno
import os
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar, Literal, cast

import pytest

from rig.io.driver import DriverError
from rig.io.registry import DriverSpec
from rig.io.settings import LoopSettings
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.supervisor.processes import safety_thread as module
from rig.supervisor.processes.driven import Driven
from rig.supervisor.processes.health import trips_of
from rig.supervisor.processes.safety_thread import Parts, SafetyThread
from tests.waiting import PATIENCE_S, until

LATER_NS = int(3600e9)
SAFE: list[str] = []
READ: dict[str, dict[str, float]] = {}
DRIVEN: dict[str, str] = {}


@dataclass
class FakeChild:
    """A process that lives until it is ended."""

    name: str
    exit_code: int | None = None

    @property
    def ended(self) -> str:
        return "" if self.exit_code is None else f"ended with exit code {self.exit_code}"


@dataclass
class FakeDriver:
    """A driver that notes that it was made safe."""

    kind: ClassVar[Literal["fast", "slow"]] = "slow"
    Options: ClassVar[type] = type

    name: str
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    rate_hz: float = 1.0

    def open(self) -> None: ...

    def read(self) -> Mapping[str, float]:
        return READ.get(self.name, {})

    def write(self, outputs: Mapping[str, float]) -> None: ...

    def safe_state(self) -> None:
        if self.name == "broken":
            raise DriverError(self.name, "no answer", "cut its supply")
        SAFE.append(self.name)

    def close(self) -> None: ...


class FakeFastDriver(FakeDriver):
    """One that tells what is driven, as the fast one does; no loop runs on it."""

    kind = "fast"

    def fileno(self) -> int:
        raise NotImplementedError

    plan = look_plan = fileno

    def driven(self) -> str:
        return DRIVEN.get(self.name, "")


class FakeSpec(DriverSpec):
    """A spec of a fake driver."""

    def create(self) -> Any:
        return (FakeFastDriver if self.kind == "fast" else FakeDriver)(self.name)


def spec(name: str, kind: Literal["fast", "slow"], *outputs: str) -> DriverSpec:
    return FakeSpec(name, "fake", "", None, kind, (), outputs, 1.0)


DRIVERS = (
    spec("pump", "slow", "pump_load"),
    spec("meters", "slow"),
    spec("daq", "fast", "command_V"),
    spec("bypass", "slow", "external_leakage_1_ball"),
)


def rig_of(drivers: tuple[DriverSpec, ...]) -> Any:
    """Return what the safety thread needs of a rig with these drivers."""
    return SimpleNamespace(loop=LoopSettings(), drivers=drivers)


@dataclass
class Scene:
    """A session whose parts are all well."""

    board: Board
    loop: FakeChild = dataclasses.field(default_factory=lambda: FakeChild("loop"))
    field: FakeChild = dataclasses.field(default_factory=lambda: FakeChild("field"))
    recorder: FakeChild = dataclasses.field(default_factory=lambda: FakeChild("recorder"))
    told: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    found: list[Driven] = dataclasses.field(default_factory=list)

    def watch(self, drivers: tuple[DriverSpec, ...] = DRIVERS) -> SafetyThread:
        parts, rig = Parts(*cast(Any, (self.loop, self.field, self.recorder))), rig_of(drivers)
        told = self.told
        watch = SafetyThread(
            self.board, parts, rig, lambda *words: told.append(words), self.found.append
        )
        watch.start()
        return watch

    def confirm(self, *words: Word) -> None:
        for word in words:
            self.board.words[word] = time.monotonic_ns()


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    monkeypatch.setattr(module, "NULL_WAIT_S", 0.2)
    monkeypatch.setattr(module, "FIELD_WAIT_S", 0.2)
    monkeypatch.setattr(module, "REPEAT_S", 0.02)
    for kept in (SAFE, READ, DRIVEN):
        kept.clear()
    board = Board.create(1)
    for word in (Word.LOOP_BEAT, Word.FIELD_BEAT, Word.RECORDER_BEAT):
        board.words[word] = time.monotonic_ns() + LATER_NS
    yield Scene(board)
    os.close(board.fd)


def outcome(scene: Scene, watch: SafetyThread) -> dict[str, Cause]:
    """Wait until the rig is safe; return who tripped, and why."""
    assert watch.wait_until_safe(PATIENCE_S)
    watch.stop()
    return {who: cause for who, (cause, _) in trips_of(scene.board).items()}


def test_while_all_is_well_it_beats_and_trips_nothing(scene: Scene) -> None:
    watch = scene.watch()
    beats: set[int] = set()

    def look() -> None:
        beats.add(int(scene.board.words[Word.SUPERVISOR_BEAT]))

    until(lambda: len(beats) >= 5, "five beats", meanwhile=look)
    assert not watch.tripped
    watch.stop()
    assert SAFE == []


def test_while_the_parts_are_ended_it_beats_on_and_takes_none_for_lost(scene: Scene) -> None:
    watch = scene.watch()
    watch.stand_down()
    scene.loop.exit_code = scene.field.exit_code = 0
    beats: set[int] = set()

    def look() -> None:
        beats.add(int(scene.board.words[Word.SUPERVISOR_BEAT]))

    until(lambda: len(beats) >= 5, "five beats", meanwhile=look)
    watch.stop()
    assert not watch.tripped
    assert SAFE == []


def test_a_supervisor_that_hangs_beats_no_more(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MAIN_SILENCE_S", -1.0)
    watch = scene.watch()
    time.sleep(0.1)
    watch.stop()
    assert scene.board.words[Word.SUPERVISOR_BEAT] == 0


def test_a_dead_loop_is_named_and_the_valve_nulled_by_another_connection(scene: Scene) -> None:
    scene.confirm(Word.BYPASS_SHUT_AT, Word.PUMP_UNLOADED_AT)
    scene.loop.exit_code = -9
    assert outcome(scene, scene.watch()) == {"supervisor": Cause.LOOP_LOST}
    assert SAFE == ["daq"]


def test_a_dead_field_process_is_named_and_its_valves_shut_by_other_connections(
    scene: Scene,
) -> None:
    scene.confirm(Word.VALVE_NULL_AT)
    scene.field.exit_code = -9
    assert outcome(scene, scene.watch()) == {"supervisor": Cause.FIELD_LOST}
    assert SAFE == ["bypass", "pump"]


@pytest.mark.parametrize(
    ("word", "cause"),
    [
        (Word.LOOP_BEAT, Cause.LOOP_LOST),
        (Word.FIELD_BEAT, Cause.FIELD_LOST),
        (Word.RECORDER_BEAT, Cause.RECORDER_LOST),
    ],
)
def test_a_part_that_is_silent_is_lost_though_its_process_lives(
    scene: Scene, word: Word, cause: Cause
) -> None:
    scene.board.words[word] = 1
    assert outcome(scene, scene.watch()) == {"supervisor": cause}
    assert SAFE == ["daq", "bypass", "pump"]


@pytest.mark.parametrize(
    ("code", "cause"),
    [
        (errno.ENOSPC, Cause.DISK_FULL),
        (errno.EDQUOT, Cause.DISK_FULL),
        (errno.EFBIG, Cause.DISK_FULL),
        (-9, Cause.RECORDER_LOST),
    ],
)
def test_a_recorder_that_ended_tells_whether_the_disk_is_full(
    scene: Scene, code: int, cause: Cause
) -> None:
    scene.confirm(Word.VALVE_NULL_AT, Word.BYPASS_SHUT_AT, Word.PUMP_UNLOADED_AT)
    scene.recorder.exit_code = code
    assert outcome(scene, scene.watch()) == {"supervisor": cause}
    assert SAFE == []


def test_what_living_parts_confirm_is_left_to_them(scene: Scene) -> None:
    scene.confirm(Word.VALVE_NULL_AT, Word.BYPASS_SHUT_AT, Word.PUMP_UNLOADED_AT)
    scene.board.words[Word.LOOP_TRIP] = Cause.ESTOP_OPEN
    assert outcome(scene, scene.watch()) == {"loop": Cause.ESTOP_OPEN}
    assert SAFE == []


def test_what_a_living_part_does_not_confirm_in_time_is_done_for_it(scene: Scene) -> None:
    scene.board.words[Word.LOOP_TRIP] = Cause.EXCHANGE_LOST
    outcome(scene, scene.watch())
    assert SAFE == ["daq", "bypass", "pump"]


def test_a_part_that_confirms_nothing_is_waited_for_once_however_many_steps_it_has(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[float] = []
    confirmed = SafetyThread._confirmed

    def counted(self: SafetyThread, *of: Any) -> bool:
        waits.append(of[-1])
        return confirmed(self, *of)

    monkeypatch.setattr(SafetyThread, "_confirmed", counted)
    scene.board.words[Word.LOOP_TRIP] = Cause.EXCHANGE_LOST
    outcome(scene, scene.watch())
    assert waits == [module.NULL_WAIT_S, module.FIELD_WAIT_S]


def test_what_cannot_be_made_safe_is_reported_and_the_rest_done(scene: Scene) -> None:
    scene.loop.exit_code = 1
    broken = spec("broken", "fast", "command_V")
    outcome(scene, scene.watch((broken, *DRIVERS[:1])))
    assert SAFE == ["pump"]
    assert ("broken", "not confirmed safe: broken: no answer; cut its supply") in scene.told


def test_the_first_trip_stays(scene: Scene) -> None:
    watch = scene.watch()
    watch.trip(Cause.OPERATOR_STOP)
    watch.trip(Cause.LOOP_LOST)
    assert outcome(scene, watch) == {"supervisor": Cause.OPERATOR_STOP}


class ForeignSpec(DriverSpec):
    """A spec of a driver that fails as no driver should."""

    def create(self) -> Any:
        raise ZeroDivisionError("of a driver")


def test_a_driver_that_fails_as_none_should_keeps_no_other_from_its_safe_state(
    scene: Scene,
) -> None:
    foreign = ForeignSpec("bypass", "fake", "", None, "slow", (), ("internal_leakage_ball",), 1.0)
    scene.field.exit_code = -9
    scene.confirm(Word.VALVE_NULL_AT)
    outcome(scene, scene.watch((foreign, spec("pump", "slow", "pump_load"))))
    assert SAFE == ["pump"]
    told = dict(scene.told)
    assert "not confirmed safe: ZeroDivisionError: of a driver" in told["bypass"]


def test_a_safety_thread_that_fails_trips_and_makes_the_rig_safe(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(watch: SafetyThread, word: Word, silence_s: float) -> bool:
        raise ZeroDivisionError("of the safety thread")

    monkeypatch.setattr(SafetyThread, "_is_silent", fails)
    assert outcome(scene, scene.watch()) == {"supervisor": Cause.CRASH}
    assert SAFE == ["daq", "bypass", "pump"]
    told = dict(scene.told)
    assert "the safety thread goes on after a failure: ZeroDivisionError" in told["supervisor"]


def test_a_rig_is_made_safe_though_nobody_can_be_told(scene: Scene) -> None:
    def full(who: str, what: str) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    parts = Parts(*cast(Any, (scene.loop, scene.field, scene.recorder)))
    scene.field.exit_code = -9
    watch = SafetyThread(scene.board, parts, rig_of(DRIVERS), full, scene.found.append)
    watch.start()
    outcome(scene, watch)
    assert set(SAFE) == {"daq", "bypass", "pump"}


def test_what_it_made_safe_by_its_own_connections_it_keeps_safe_and_tells_who_drives_it(
    scene: Scene,
) -> None:
    scene.loop.exit_code = -9
    watch = scene.watch()
    assert watch.wait_until_safe(PATIENCE_S)
    assert set(watch.made_safe) == {"valve null", "bypass shut", "pump unloaded"}
    DRIVEN["daq"] = "has valve_enabled at 1"
    READ["pump"] = {"pump_loaded": 1.0}
    until(lambda: {found.part for found in scene.found} == {"valve", "pump"})
    watch.stop()
    assert all(SAFE.count(name) > 1 for name in ("daq", "bypass", "pump"))
    assert {(found.part, found.text) for found in scene.found} == {
        ("valve", "has valve_enabled at 1"),
        ("pump", "loaded"),
    }
    # Told once each, not with every look.
    told = [who for who, what in scene.told if "own connection" in what]
    assert sorted(told) == ["bypass", "daq", "pump"]
