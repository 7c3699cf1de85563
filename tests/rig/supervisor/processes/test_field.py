"""The field process: publishes slow values, moves on time, and is safe when anybody is not well."""

import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, ClassVar, Literal

import numpy as np
import pytest

from rig.io.driver import DriverError
from rig.io.registry import DriverSpec
from rig.io.settings import LoopSettings
from rig.io.signals import SLOW_INPUTS
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.supervisor.processes import field as field_module
from rig.supervisor.processes.child import News
from rig.supervisor.processes.driven import Driven
from rig.supervisor.processes.field import (
    FieldProcess,
    FollowMoves,
    MakeSafe,
    OpenField,
    WriteOutputs,
)
from tests.waiting import PATIENCE_S, until


@dataclass(frozen=True)
class Options:
    """None."""


@dataclass
class FakeDriver:
    """A driver that notes what it is asked for."""

    kind: ClassVar[Literal["slow"]] = "slow"
    Options: ClassVar[type] = Options

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    log: list[tuple[str, Any]]
    rate_hz: float = 100.0
    values: dict[str, float] = field(default_factory=dict)
    error: DriverError | None = None
    unsafe: DriverError | None = None
    once_safe: DriverError | None = None

    def open(self) -> None:
        self.log.append((self.name, "open"))

    def read(self) -> Mapping[str, float]:
        if self.error is not None:
            raise self.error
        if self.once_safe is not None and (self.name, "safe") in self.log:
            raised, self.once_safe = self.once_safe, None
            raise raised
        return self.values

    def write(self, outputs: Mapping[str, float]) -> None:
        self.log.append((self.name, dict(outputs)))

    def safe_state(self) -> None:
        self.log.append((self.name, "safe"))
        if self.unsafe is not None:
            raise self.unsafe
        self.values = {name: 0.0 for name in self.values if name in self.inputs}

    def close(self) -> None:
        self.log.append((self.name, "close"))


DRIVERS: dict[str, FakeDriver] = {}


OIL = TransducerCalibration(
    "oil_temperature_K",
    "T-1",
    date(2026, 3, 2),
    date(2027, 3, 2),
    (CalibrationPoint(273.0, 275.0), CalibrationPoint(313.0, 317.0)),
)


class FakeSpec(DriverSpec):
    """A spec of a driver that is there already: orders are pickled, drivers stay."""

    def create(self) -> Any:
        return DRIVERS[self.name]


@dataclass
class Site:
    """A field process in a thread, with its board and the supervisor's end of its pipe."""

    board: Board
    pipe: Connection
    log: list[tuple[str, Any]]
    bypass: FakeDriver
    pump: FakeDriver
    meters: FakeDriver

    def beat(self) -> None:
        """Be supervisor and loop, both well, for a long while."""
        later = time.monotonic_ns() + int(3600e9)
        self.board.words[Word.SUPERVISOR_BEAT] = self.board.words[Word.LOOP_BEAT] = later

    def until(self, reached: Any) -> None:
        """Wait for a condition."""
        until(reached, f"what did not come after {self.log}")

    def trips(self) -> dict[Word, int]:
        words = (Word.FIELD_TRIP, Word.LOOP_TRIP, Word.SUPERVISOR_TRIP)
        return {word: int(self.board.words[word]) for word in words if self.board.words[word]}


@pytest.fixture
def site() -> Iterator[Site]:
    log: list[tuple[str, Any]] = []
    bypass = FakeDriver("bypass", ("external_leakage_1_ball",), ("external_leakage_1_ball",), log)
    pump = FakeDriver("pump", ("pump_loaded",), ("pump_load",), log)
    meters = FakeDriver("meters", ("flow_1_m3_per_s",), (), log)
    board = Board.create(1)
    ours, theirs = Pipe()
    site = Site(board, ours, log, bypass, pump, meters)
    site.beat()
    process = FieldProcess(board, theirs)
    thread = threading.Thread(target=process.run)
    # The pump first: the order of a trip does not follow that of the file.
    DRIVERS.update({driver.name: driver for driver in (pump, meters, bypass)})
    drivers = tuple(
        FakeSpec(d.name, "fake", "", Options(), d.kind, d.inputs, d.outputs, d.rate_hz)
        for d in (pump, meters, bypass)
    )
    thread.start()
    ours.send(OpenField(drivers, LoopSettings(), (OIL,)))
    assert ours.recv() == ("pump", "meters", "bypass")
    yield site
    ours.close()
    thread.join(PATIENCE_S)
    assert not thread.is_alive()
    theirs.close()


def test_what_drivers_read_stands_on_the_board_with_its_time(site: Site) -> None:
    site.meters.values = {"flow_1_m3_per_s": 1e-5}
    index = SLOW_INPUTS.index("flow_1_m3_per_s")
    site.until(lambda: site.board.slow[index] == 1e-5)
    assert site.board.slow_at[index] > 0
    assert np.isnan(site.board.slow[SLOW_INPUTS.index("oil_temperature_K")])


def test_a_calibrated_value_is_corrected_before_it_stands_on_the_board(site: Site) -> None:
    site.meters.values = {"oil_temperature_K": 315.0, "pump_pressure_Pa": 1.38e7}
    index = SLOW_INPUTS.index("oil_temperature_K")
    site.until(lambda: site.board.slow[index] == OIL.corrected(315.0))
    assert 311.0 < site.board.slow[index] < 311.2
    assert site.board.slow[SLOW_INPUTS.index("pump_pressure_Pa")] == 1.38e7


def test_a_move_is_made_when_its_tick_has_come_and_in_its_segment_only(site: Site) -> None:
    opened = ("bypass", {"external_leakage_1_ball": 1.0})
    site.pipe.send(FollowMoves(4, ((100, {"external_leakage_1_ball": 1.0}),)))
    site.board.words[Word.TICK] = 100
    site.board.words[Word.SEGMENT] = 3
    beat = site.board.words[Word.FIELD_BEAT]
    site.until(lambda: site.board.words[Word.FIELD_BEAT] > beat + 50_000_000)
    assert opened not in site.log
    site.board.words[Word.TICK] = 99
    site.board.words[Word.SEGMENT] = 4
    beat = site.board.words[Word.FIELD_BEAT]
    site.until(lambda: site.board.words[Word.FIELD_BEAT] > beat + 50_000_000)
    assert opened not in site.log
    site.board.words[Word.TICK] = 100
    site.until(lambda: opened in site.log)
    assert site.log.count(opened) == 1


def test_an_output_goes_to_the_driver_that_has_it(site: Site) -> None:
    site.pipe.send(WriteOutputs({"pump_load": 1.0, "external_leakage_1_ball": 0.0}))
    site.until(lambda: len(site.log) >= 5)
    assert ("pump", {"pump_load": 1.0}) in site.log
    assert ("bypass", {"external_leakage_1_ball": 0.0}) in site.log


@pytest.mark.parametrize("word", [Word.LOOP_TRIP, Word.SUPERVISOR_TRIP, Word.FIELD_TRIP])
def test_after_any_trip_the_bypasses_are_shut_and_then_the_pump_is_unloaded(
    site: Site, word: Word
) -> None:
    site.board.words[word] = Cause.ESTOP_OPEN
    site.until(lambda: site.board.words[Word.PUMP_UNLOADED_AT])
    assert [entry[0] for entry in site.log if entry[1] == "safe"][:2] == ["bypass", "pump"]
    assert 0 < site.board.words[Word.BYPASS_SHUT_AT] <= site.board.words[Word.PUMP_UNLOADED_AT]


@pytest.mark.parametrize("word", [Word.LOOP_TRIP, Word.SUPERVISOR_TRIP, Word.FIELD_TRIP])
def test_after_any_trip_no_driver_is_made_safe_before_the_servovalve_is_at_null(
    site: Site, monkeypatch: pytest.MonkeyPatch, word: Word
) -> None:
    monkeypatch.setattr(field_module, "_NULL_FIRST_S", PATIENCE_S)
    site.board.words[word] = Cause.ESTOP_OPEN
    time.sleep(0.05)
    assert "safe" not in [entry[1] for entry in site.log]
    site.board.words[Word.VALVE_NULL_AT] = time.monotonic_ns()
    site.until(lambda: site.board.words[Word.PUMP_UNLOADED_AT])


def test_what_a_driver_says_once_of_itself_is_reported_though_it_was_made_safe_meanwhile(
    site: Site,
) -> None:
    DRIVERS["pump"].once_safe = DriverError("pump", "emergency 0x3100", "check its supply")
    site.board.words[Word.LOOP_TRIP] = Cause.SPOOL_NOT_FOLLOWING
    site.board.words[Word.VALVE_NULL_AT] = 1
    told = site.pipe.recv()
    assert isinstance(told, News)
    assert (told.who, told.text) == ("pump", "emergency 0x3100; check its supply")
    assert site.board.words[Word.FIELD_TRIP] == Cause.NONE


def test_what_a_trip_confirmed_keeps_its_time_when_the_session_ends(site: Site) -> None:
    words = site.board.words
    words[Word.SUPERVISOR_TRIP] = Cause.RECORDER_LOST
    site.until(lambda: words[Word.PUMP_UNLOADED_AT])
    confirmed = int(words[Word.BYPASS_SHUT_AT]), int(words[Word.PUMP_UNLOADED_AT])
    site.pipe.close()
    # On its way out it makes everything safe once more.
    site.until(lambda: site.log.count(("pump", "safe")) == 2)
    site.until(lambda: ("pump", "close") in site.log)
    assert (words[Word.BYPASS_SHUT_AT], words[Word.PUMP_UNLOADED_AT]) == confirmed


def test_what_moved_after_it_was_confirmed_safe_has_to_be_confirmed_anew(site: Site) -> None:
    words = site.board.words
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}
    before = int(words[Word.BYPASS_SHUT_AT])
    site.pipe.send(WriteOutputs({"external_leakage_1_ball": 1.0}))
    site.until(lambda: not words[Word.BYPASS_SHUT_AT])
    assert words[Word.PUMP_UNLOADED_AT]
    words[Word.LOOP_TRIP] = Cause.ESTOP_OPEN
    site.until(lambda: words[Word.BYPASS_SHUT_AT])
    assert words[Word.BYPASS_SHUT_AT] > before


def test_the_board_shows_the_safe_state_before_it_is_said_to_be_reached(site: Site) -> None:
    index = SLOW_INPUTS.index("pump_loaded")
    site.pump.values = {"pump_loaded": 1.0}
    # So seldom that the next time would be too late.
    site.pump.rate_hz, now = 1e-3, time.monotonic_ns()
    site.until(lambda: site.board.slow_at[index] > now)
    assert site.board.slow[index] == 1.0

    def unload() -> None:
        site.pump.values = {"pump_loaded": 0.0}

    site.pump.safe_state = unload  # type: ignore[method-assign]
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}
    assert site.board.slow[index] == 0.0


@pytest.mark.parametrize(
    ("word", "cause"),
    [(Word.LOOP_BEAT, Cause.LOOP_LOST), (Word.SUPERVISOR_BEAT, Cause.SUPERVISOR_LOST)],
)
def test_the_silence_of_another_part_trips(site: Site, word: Word, cause: Cause) -> None:
    site.board.words[word] = 1
    site.until(lambda: site.board.words[Word.PUMP_UNLOADED_AT])
    assert site.trips() == {Word.FIELD_TRIP: cause}


def test_a_valve_that_does_not_do_what_it_should_trips_and_is_named(site: Site) -> None:
    channel = "external_leakage_1_ball"
    site.bypass.error = DriverError("bypass", "stuck at 0.42", "free the valve", channel)
    site.until(lambda: site.board.words[Word.BYPASS_SHUT_AT])
    assert site.trips() == {Word.FIELD_TRIP: Cause.BYPASS_STUCK}
    told = site.pipe.recv()
    assert isinstance(told, News)
    assert told.who == "bypass"
    assert "stuck at 0.42" in told.text


def test_a_blocking_valve_that_does_not_is_told_apart_from_a_bypass(site: Site) -> None:
    site.bypass.inputs = site.bypass.outputs = ("external_leakage_1_ball", "blocking_2")
    site.bypass.error = DriverError("bypass", "stuck at 1", "look at it", "blocking_2")
    site.until(lambda: site.board.words[Word.BYPASS_SHUT_AT])
    assert site.trips() == {Word.FIELD_TRIP: Cause.BLOCKING_STUCK}


def test_a_device_that_refuses_to_answer_is_lost_and_none_of_its_valves_stuck(site: Site) -> None:
    site.bypass.error = DriverError("bypass", "refuses", "check the address", "switches")
    site.until(lambda: site.board.words[Word.BYPASS_SHUT_AT])
    assert site.trips() == {Word.FIELD_TRIP: Cause.BYPASS_LOST}


def test_lost_meters_are_reported_but_trip_nothing_and_read_nan(site: Site) -> None:
    site.meters.values = {"flow_1_m3_per_s": 1e-5}
    index = SLOW_INPUTS.index("flow_1_m3_per_s")
    site.until(lambda: site.board.slow[index] == 1e-5)
    site.meters.error = DriverError("meters", "silent", "plug them in")
    site.until(lambda: np.isnan(site.board.slow[index]))
    told = site.pipe.recv()
    assert isinstance(told, News)
    assert not site.trips()


def test_asked_for_it_makes_everything_safe_and_says_so(site: Site) -> None:
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}


def test_what_cannot_be_made_safe_is_named_and_the_rest_is_safe_all_the_same(site: Site) -> None:
    def refuse() -> None:
        raise DriverError("bypass", "shut switch is off", "shut it by hand")

    site.bypass.safe_state = refuse  # type: ignore[method-assign]
    site.pipe.send(MakeSafe())
    answers = [site.pipe.recv()]
    while not isinstance(answers[-1], dict):
        answers.append(site.pipe.recv())
    assert "shut switch is off" in answers[-1]["bypass"]
    assert ("pump", "safe") in site.log
    assert not site.board.words[Word.BYPASS_SHUT_AT]
    told = answers[0]
    assert isinstance(told, News)
    assert (told.who, told.text) == ("bypass", "shut switch is off; shut it by hand")


def test_a_driver_that_could_not_be_made_safe_is_not_asked_any_more(site: Site) -> None:
    def refuse() -> None:
        raise DriverError("bypass", "shut switch is off", "shut it by hand")

    site.bypass.safe_state = refuse  # type: ignore[method-assign]
    site.pipe.send(MakeSafe())
    while not isinstance(site.pipe.recv(), dict):
        pass
    site.bypass.error = DriverError("bypass", "is not open", "open it first")
    flow = SLOW_INPUTS.index("flow_1_m3_per_s")
    for value in (1e-5, 2e-5, 3e-5):
        site.meters.values = {"flow_1_m3_per_s": value}
        site.until(lambda value=value: site.board.slow[flow] == value)
    assert not site.pipe.poll()


def test_without_a_supervisor_it_leaves_everything_safe_and_closes(site: Site) -> None:
    site.pipe.close()
    site.until(lambda: ("pump", "close") in site.log)
    assert ("bypass", "safe") in site.log


def times_safe(site: Site, name: str) -> int:
    return site.log.count((name, "safe"))


@pytest.mark.parametrize(
    ("name", "channel", "part", "what"),
    [
        ("bypass", "external_leakage_1_ball", "external leakage 1 bypass", "open"),
        ("pump", "pump_loaded", "pump", "loaded"),
    ],
)
def test_what_another_master_drives_after_a_trip_is_brought_back_and_reported(
    site: Site, name: str, channel: str, part: str, what: str
) -> None:
    driver = DRIVERS[name]
    site.board.words[Word.LOOP_TRIP] = Cause.ESTOP_OPEN
    site.board.words[Word.VALVE_NULL_AT] = 1
    site.until(lambda: bool(site.board.words[Word.PUMP_UNLOADED_AT]))
    for count in (2, 3, 4):
        driver.values = {channel: 1.0}
        site.until(lambda count=count: times_safe(site, name) >= count)
        site.until(lambda: driver.values == {channel: 0.0})
    told = site.pipe.recv()
    assert isinstance(told, Driven)
    assert (told.who, told.part, told.text) == ("field", part, what)
    # Only who was driven is made safe anew.
    assert all(times_safe(site, other) == 1 for other in ("bypass", "pump") if other != name)


def test_while_nobody_tripped_an_open_bypass_is_what_was_asked_for(site: Site) -> None:
    site.bypass.values = {"external_leakage_1_ball": 1.0}
    index = SLOW_INPUTS.index("external_leakage_1_ball")
    site.until(lambda: site.board.slow[index] == 1.0)
    assert times_safe(site, "bypass") == 0


def test_a_driver_that_cannot_be_made_safe_is_tried_again_until_it_is(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.supervisor.processes.field._REPEAT_S", 0.05)
    site.bypass.unsafe = DriverError("bypass", "no answer", "look at it")
    site.board.words[Word.LOOP_TRIP] = Cause.ESTOP_OPEN
    site.board.words[Word.VALVE_NULL_AT] = 1
    site.until(lambda: times_safe(site, "bypass") >= 3)
    assert not site.board.words[Word.BYPASS_SHUT_AT]
    site.bypass.unsafe = None
    site.until(lambda: bool(site.board.words[Word.BYPASS_SHUT_AT]))
    told = [site.pipe.recv() for _ in range(2)]
    # However often it failed, it is reported once.
    assert [news.text for news in told] == ["no answer; look at it", "is in its safe state now"]


def test_a_driver_that_is_lost_after_a_trip_is_made_safe_once_it_is_back(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.supervisor.processes.field._REPEAT_S", 0.05)
    site.board.words[Word.LOOP_TRIP] = Cause.ESTOP_OPEN
    site.board.words[Word.VALVE_NULL_AT] = 1
    site.until(lambda: bool(site.board.words[Word.PUMP_UNLOADED_AT]))
    site.bypass.error = DriverError("bypass", "no answer", "look at it")
    site.until(lambda: times_safe(site, "bypass") >= 2)
    site.bypass.error = None
    told = [site.pipe.recv() for _ in range(2)]
    assert [news.text for news in told] == ["no answer; look at it", "is in its safe state now"]


@pytest.mark.parametrize(
    ("trips", "own"), [(True, {}), (False, {Word.FIELD_TRIP: Cause.FIELD_LOST})]
)
def test_a_process_that_was_stopped_looks_for_a_trip_before_it_goes_on_to_the_next_driver(
    site: Site, trips: bool, own: dict[Word, int]
) -> None:
    woken = threading.Event()
    read_bypass = site.bypass.read

    def stopped() -> Mapping[str, float]:
        """Be stopped for 1.7 s while the meters are read; the supervisor may trip meanwhile."""
        if not woken.is_set():
            if trips:
                site.board.words[Word.VALVE_NULL_AT] = 1
                site.board.words[Word.SUPERVISOR_TRIP] = Cause.FIELD_LOST
            site.board.words[Word.FIELD_BEAT] = time.monotonic_ns() - 1_700_000_000
            site.log.append(("field", "wakes"))
            woken.set()
        return {}

    def noted() -> Mapping[str, float]:
        site.log.append(("bypass", "read"))
        return read_bypass()

    # The bypass is read right after the meters, as it is due in every cycle.
    site.bypass.rate_hz = 1e6
    site.bypass.read = noted  # type: ignore[method-assign]
    site.meters.read = stopped  # type: ignore[method-assign]
    site.until(lambda: site.board.words[Word.PUMP_UNLOADED_AT])
    after = site.log[site.log.index(("field", "wakes")) + 1 :]
    assert after[0] == ("bypass", "safe")
    by_supervisor = {Word.SUPERVISOR_TRIP: Cause.FIELD_LOST} if trips else {}
    assert site.trips() == by_supervisor | own


def test_a_process_that_waits_for_a_device_to_become_safe_is_alive(site: Site) -> None:
    beats: set[int] = set()

    def beats_on() -> bool:
        beats.add(int(site.board.words[Word.FIELD_BEAT]))
        return len(beats) > 3

    def slow() -> None:
        until(beats_on, "beats")

    site.bypass.safe_state = slow  # type: ignore[method-assign]
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}
    assert len(beats) > 3


def test_a_process_that_gets_no_thread_for_its_beats_makes_its_devices_safe_all_the_same(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(thread: threading.Thread) -> None:
        raise OSError("no further thread")

    monkeypatch.setattr("rig.supervisor.processes.field.start", refuse)
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}
    assert ("bypass", "safe") in site.log


def test_an_order_to_move_that_comes_after_a_trip_is_dropped(site: Site) -> None:
    site.board.words[Word.VALVE_NULL_AT] = 1
    site.board.words[Word.SUPERVISOR_TRIP] = Cause.FIELD_LOST
    site.pipe.send(WriteOutputs({"pump_load": 1.0}))
    site.pipe.send(MakeSafe())
    assert site.pipe.recv() == {}
    assert ("pump", "safe") in site.log
    assert ("pump", {"pump_load": 1.0}) not in site.log
    assert site.board.words[Word.PUMP_UNLOADED_AT]
