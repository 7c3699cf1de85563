"""When the servovalve may move and when the blocking valves may, in a leak test on hardware."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.filters import DEFAULT_FILTER, start_memory
from rig.configuration import load_model, load_rig
from rig.loop import Drive, SetAhead, Word, wire_channels
from rig.loop.board import Board
from rig.loop.wire.ahead import set_ahead
from rig.loop.wire.orders import Segment
from rig.plant import TICK
from rig.supervisor import locking
from rig.supervisor.locking import KEPT_TICKS, MOST_COMMAND_V, WAY_M, LockedRig

HERE = 0.3


class FakeRig:
    """A rig whose loop follows what is laid out, and whose blocking valves move at once."""

    def __init__(self) -> None:
        self.configured = load_rig("emulated_locked")
        self.model = load_model("nominal")
        memory = start_memory(DEFAULT_FILTER, self.model, self.configured.sensors)
        self._segment = Segment(0, Drive.TRACK, memory, self.model.parameters)
        self._names = wire_channels(memory.filter.states, open_loop=False)
        self.board = Board.create(len(self._names))
        self.parts = SimpleNamespace(loop=None)
        self.safety = SimpleNamespace(tripped=False)
        self.event_log = SimpleNamespace(test_limits=())
        self.said: list[tuple[str, Any]] = []
        self.segment_sent: dict[str, Any] = {}
        self._valves = {"blocking_1": 0.0, "blocking_2": 0.0}

    def segment(self, drive: Drive) -> Segment:
        assert drive is Drive.NULL
        return self._segment

    def latest(self, channel: str) -> float:
        return {"position_m": HERE}[channel]

    def handle(self, event: Any) -> None:
        self.said.append(("state", event.value))

    def switch_to(self, drive: Drive, **changes: Any) -> None:
        words = self.board.words
        words[Word.SWITCH] += 1
        words[Word.SEGMENT] = words[Word.SWITCH]
        words[Word.TICK] = 0
        self.segment_sent = {"drive": drive, **changes}
        if drive is Drive.TRACK:
            self._follow(1)

    def wait(self, done: Any, *_: Any) -> None:
        assert done()

    def ask(self, part: object, order: SetAhead, timeout_s: float) -> bool:
        setpoint = self.segment_sent["setpoint"]
        guide = self.segment_sent["guide"]
        taken = set_ahead(order, setpoint, guide.feedforward, self.board.words)
        self._follow(40)
        return taken

    def _follow(self, ticks: int) -> None:
        words, ring = self.board.words, self.board.ring
        for _ in range(ticks):
            tick = int(words[Word.TICK])
            row = ring[words[Word.ROWS] % ring.shape[0]]
            row[:] = np.nan
            for name, value in (
                ("time_s", tick * TICK), ("segment", words[Word.SEGMENT]), ("position_m", HERE),
                ("command_V", self.segment_sent["setpoint"][tick]),
                ("pressure_1_Pa", 7e6), ("pressure_2_Pa", 7e6),
            ):  # fmt: skip
                row[self._names.index(name)] = value
            self._command = float(self.segment_sent["setpoint"][tick])
            words[Word.ROWS] += 1
            words[Word.TICK] = tick + 1

    def check(self) -> None:
        pass

    def going_on(self) -> None:
        pass

    def write(self, outputs: dict[str, float]) -> None:
        self.said.append(("valves", (dict(outputs), self._command)))
        self._valves = dict(outputs)

    def off(self, wanted: dict[str, float]) -> list[str]:
        return [name for name, value in wanted.items() if self._valves[name] != value]


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> FakeRig:
    resting = SimpleNamespace(rest=lambda duration_s: None, shut_bypasses=lambda: None)
    monkeypatch.setattr(locking, "Strokes", lambda rig: resting)
    return FakeRig()


def locked(rig: FakeRig) -> LockedRig:
    return LockedRig(rig)  # type: ignore[arg-type]


def orders(rig: FakeRig) -> list[tuple[dict[str, float], float]]:
    """The orders to the valves, each with the command that the loop gave at that moment."""
    return [what for who, what in rig.said if who == "valves"]


def test_the_first_valve_shuts_with_the_servovalve_at_null(rig: FakeRig) -> None:
    test = locked(rig)
    test.exchange(0.4)
    test.block(True, True)
    assert orders(rig) == [({"blocking_1": 1.0, "blocking_2": 1.0}, 0.0)]


def test_a_regulated_chambers_valve_shuts_while_the_other_one_holds_the_ram(rig: FakeRig) -> None:
    test = locked(rig)
    test.block(False, True)
    test.exchange(0.4)
    test.block(True, True)
    assert orders(rig)[-1] == ({"blocking_1": 1.0, "blocking_2": 1.0}, 0.4)


def test_a_valve_opens_with_the_servovalve_at_null_only(rig: FakeRig) -> None:
    test = locked(rig)
    test.block(True, True)
    test.exchange(-0.3)
    test.block(False, True)
    assert orders(rig)[-1] == ({"blocking_1": 0.0, "blocking_2": 1.0}, 0.0)


def test_however_a_test_ends_null_comes_first_and_both_valves_open_then(rig: FakeRig) -> None:
    test = locked(rig)
    test.block(True, True)
    test.exchange(0.3)
    test.release()
    assert orders(rig)[-1] == ({"blocking_1": 0.0, "blocking_2": 0.0}, 0.0)
    assert test.arrived
    assert rig.segment_sent["drive"] is Drive.HOLD


def test_after_a_trip_the_field_process_opens_them_and_nobody_else_orders(rig: FakeRig) -> None:
    test = locked(rig)
    test.block(True, True)
    rig.safety.tripped = True
    test.release()
    assert len(orders(rig)) == 1


def test_a_command_without_another_one_ends_at_null(rig: FakeRig) -> None:
    test = locked(rig)
    test.exchange(0.5)
    left = rig.segment_sent["setpoint"][int(rig.board.words[Word.TICK]) :]
    assert left[0] == 0.5
    assert np.count_nonzero(left) < KEPT_TICKS
    assert left[-1] == 0.0


def test_while_locked_the_loop_trips_if_the_ram_moves_or_heat_raises_a_pressure(
    rig: FakeRig,
) -> None:
    locked(rig)
    sent = rig.segment_sent
    position, *pressures = sent["limits"]
    assert (position.channel, position.low, position.high) == (
        "position_m",
        HERE - WAY_M,
        HERE + WAY_M,
    )
    assert {limit.channel for limit in pressures} == {"pressure_1_Pa", "pressure_2_Pa"}
    supply = rig.model.parameters.supply_pressure
    assert {limit.high for limit in pressures} == {supply}
    assert {limit.action for limit in sent["limits"]} == {"trip"}
    assert sent["locked"]
    assert sent["limit"] == MOST_COMMAND_V
