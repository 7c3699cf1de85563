"""A rig is armed and homed before anything else moves it, anew in every session."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from control import ControlSettings
from rig.configuration.rigs.rig import Rig, load_rig
from rig.loop.board import Word
from rig.loop.interlocks.trip import TripError
from rig.loop.wire.layout import Drive
from rig.loop.wire.orders import Segment
from rig.plant import Model
from rig.supervisor import arming
from rig.supervisor.states import Conditions, Event, IllegalTransition, State, next_state

RIG = load_rig("emulated")
COUNT_M = RIG.sensors.position_resolution
SPEED_PER_V = 0.07
"""m/s that the ram does with a volt, no load."""
STALL_PA = 6e6
"""Pressure difference with which it pushes against a stop."""
LOST_COUNTS = 40


class Ram:
    """A ram between its stops, and an encoder that counts from where it was switched on.

    Attributes:
        position_m: where the ram is.
        zero_m: where the encoder reads 0.
        null_V: command at which it stands.
    """

    def __init__(self, position_m: float = 0.31, null_V: float = 0.0) -> None:  # noqa: N803
        self.null_V = null_V
        self.position_m = position_m
        self.zero_m = position_m
        self.pushes_V = 0.0

    @property
    def counted_m(self) -> float:
        return round((self.position_m - self.zero_m) / COUNT_M) * COUNT_M

    def drive(self, command_V: float, elapsed_s: float) -> None:  # noqa: N803
        command_V -= self.null_V  # noqa: N806
        free = self.position_m + SPEED_PER_V * command_V * elapsed_s
        self.position_m = min(max(free, 0.0), Model().parameters.stroke_max)
        self.pushes_V = 0.0 if self.position_m == free else command_V


class ConnectedRig:
    """What arming asks of a rig on which time passes only while it waits.

    Attributes:
        ordered: every segment.
        said: to the operator.
    """

    model = Model()
    now_s = 0.0

    def __init__(self, ram: Ram, configured: Rig = RIG) -> None:
        self.configured = configured
        self.board = SimpleNamespace(words=np.zeros(64, np.int64))
        self.offset_m = 0.0
        self.ordered: list[Segment] = []
        self._present = self.segment(Drive.NULL)
        self.said: list[str] = []
        self._ram = ram
        self.state = State.OFF
        for event in (Event.CONNECT, Event.CONNECTED):
            self.handle(event)

    def handle(self, event: Event) -> None:
        homed = bool(self.board.words[Word.HOMED])
        self.state = next_state(self.state, event, Conditions(True, True, homed))

    def say(self, text: str) -> None:
        self.said.append(text)

    def check(self) -> None:
        """Do nothing: all is well."""

    def write(self, outputs: Mapping[str, float]) -> None:
        """Have the valves where they shall be."""

    def off(self, wanted: Mapping[str, float]) -> list[str]:
        return []

    def latest(self, channel: str) -> float:
        push_Pa = 0.5 * STALL_PA * float(np.sign(self._ram.pushes_V))  # noqa: N806
        return {
            "position_m": self._ram.counted_m + self._present.offset_m,
            "pressure_1_Pa": 7e6 + push_Pa,
            "pressure_2_Pa": 7e6 - push_Pa,
            "valve_enabled": 1.0,
        }[channel]

    def segment(self, drive: Drive, **changes: Any) -> Segment:
        segment = Segment(0, drive, cast(Any, None), self.model.parameters, offset_m=self.offset_m)
        return replace(segment, **changes)

    def switch_to(self, drive: Drive, **changes: Any) -> None:
        segment = self.segment(drive, **changes)
        self.ordered.append(segment)
        self._present = segment
        if segment.homed is not None:
            self.board.words[Word.HOMED] = segment.homed

    def wait(self, done: Callable[[], bool], timeout_s: float, state: str, action: str) -> None:
        until = self.now_s + timeout_s
        while not done():
            assert self.now_s < until, state
            self.sleep(0.01)

    def sleep(self, elapsed_s: float) -> None:
        self.now_s += elapsed_s
        segment = self._present
        if segment.drive is not Drive.TRACK:
            return
        wanted = float(segment.setpoint[0])
        if not segment.open_loop:
            wanted = 50.0 * (wanted - self._ram.counted_m - segment.offset_m)
        self._ram.drive(min(max(wanted, -segment.limit), segment.limit), elapsed_s)


@pytest.fixture
def session(monkeypatch: pytest.MonkeyPatch) -> Callable[..., ConnectedRig]:
    """Return what connects to a ram, arms and homes it."""

    def begin(ram: Ram, configured: Rig = RIG) -> ConnectedRig:
        rig = ConnectedRig(ram, configured)
        clock = SimpleNamespace(monotonic=lambda: rig.now_s, sleep=rig.sleep)
        monkeypatch.setattr(arming, "time", clock)
        arming.arm(cast(Any, rig))
        arming.home(cast(Any, rig))
        return rig

    return begin


Begin = Callable[..., ConnectedRig]


@pytest.mark.parametrize("switched_on_m", [0.0, 0.31, 0.6])
def test_the_position_is_right_wherever_the_encoder_was_switched_on(
    session: Begin, switched_on_m: float
) -> None:
    ram = Ram(switched_on_m)
    rig = session(ram)
    assert rig.state is State.ARMED
    assert rig.latest("position_m") == pytest.approx(ram.position_m, abs=2 * COUNT_M)


def test_before_it_is_homed_a_ram_is_only_moved_gently_and_no_test_may_run(session: Begin) -> None:
    assert RIG.homing is not None
    rig = session(Ram())
    homed_at = next(i for i, segment in enumerate(rig.ordered) if segment.homed)
    moving = [segment for segment in rig.ordered[:homed_at] if segment.open_loop]
    assert moving
    assert all(segment.limit <= RIG.homing.command for segment in moving)
    for event in (Event.RUN, Event.POSITION):
        with pytest.raises(IllegalTransition):
            next_state(State.NOT_HOMED, event, Conditions(True, True, homed=False))


@pytest.mark.parametrize("null_V", [0.35, -0.35])
def test_a_ram_whose_null_is_known_is_homed_by_commands_above_it(
    session: Begin,
    null_V: float,  # noqa: N803
) -> None:
    ram = Ram(null_V=null_V)
    rig = session(ram, replace(RIG, control=ControlSettings(null=null_V)))
    # In a hold the gain alone makes up for the null: 7 mm beside where it was sent.
    assert rig.latest("position_m") == pytest.approx(ram.position_m, abs=2 * COUNT_M)


def test_a_rig_whose_signs_are_not_known_is_armed_without_a_gain(session: Begin) -> None:
    rig = ConnectedRig(Ram())
    arming.arm(cast(Any, rig), held=False)
    assert [segment.gain for segment in rig.ordered] == [0.0]


def test_every_session_homes_again_and_so_finds_a_zero_that_was_lost(session: Begin) -> None:
    ram = Ram()
    before = session(ram)
    ram.zero_m += LOST_COUNTS * COUNT_M
    assert before.latest("position_m") == pytest.approx(
        ram.position_m - LOST_COUNTS * COUNT_M, abs=2 * COUNT_M
    )
    after = session(ram)
    assert after.ordered[0].homed is False
    assert after.offset_m - before.offset_m == pytest.approx(LOST_COUNTS * COUNT_M, abs=2 * COUNT_M)
    assert after.latest("position_m") == pytest.approx(ram.position_m, abs=2 * COUNT_M)


def test_an_encoder_that_always_knows_where_it_is_is_not_homed(session: Begin) -> None:
    rig = session(Ram(), replace(RIG, homing=None))
    assert rig.state is State.ARMED
    assert [segment.drive for segment in rig.ordered] == [Drive.HOLD]


def test_a_rig_that_is_not_to_be_homed_is_not_moved(session: Begin) -> None:
    assert RIG.homing is not None
    ram = Ram()
    where = ram.position_m
    with pytest.raises(TripError, match="the rig is not homed"):
        session(ram, replace(RIG, homing=replace(RIG.homing, before_run=False)))
    assert ram.position_m == where


def test_homing_that_finds_no_stop_says_why_and_leaves_the_rig_not_homed(
    session: Begin, monkeypatch: pytest.MonkeyPatch
) -> None:
    ram = Ram()
    monkeypatch.setattr(Ram, "counted_m", 0.1)
    with pytest.raises(TripError, match="homing failed: the ram stands, but pushes"):
        session(ram)
