"""The strokes in which bypasses are measured: slow, within the limits, ended by what is amiss."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.configuration.rigs.rig import load_rig
from rig.io.signals import METERS
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError, TripError
from rig.plant.integrator import TICK
from rig.supervisor.calibration import SPEED, STROKE_S, Strokes
from rig.supervisor.states import Event

RIG = load_rig("emulated")
CHANNELS = ("time_s", "pressure_2_Pa", *METERS, "pressure_1_Pa")


class Wire:
    """A loop that follows every setpoint; a row tells its tick in every channel, plus its column.

    Args:
        fails: what ends the motion.
    """

    channels = CHANNELS

    def __init__(self, setpoint: NDArray[np.float64], fails: LoopStoppedError | None) -> None:
        self._setpoint = setpoint
        self._fails = fails
        self._done = 0

    @property
    def ticks_left(self) -> int:
        return self._setpoint.size - self._done

    def position(self) -> None:
        """Be there."""

    def advance(self, ticks: int) -> NDArray[np.float64]:
        if self._fails is not None:
            raise self._fails
        rows = np.arange(self._done, self._done + min(ticks, self.ticks_left))
        self._done += rows.size
        return rows[:, np.newaxis] + 0.1 * np.arange(len(CHANNELS))

    def safe_state(self) -> None:
        """Hold."""


class ConnectedRig:
    """What strokes ask of a rig that is armed and homed; keeps it.

    Attributes:
        started: where each motion began, and its setpoints.
        fails: what ends the motion.
        events: asked of the state machine.
        written: slow outputs, in order.
    """

    configured = RIG
    fails: LoopStoppedError | None = None

    def __init__(self) -> None:
        self.started: list[tuple[float, NDArray[np.float64]]] = []
        self.events: list[Event] = []
        self.written: list[Mapping[str, float]] = []

    def handle(self, event: Event) -> None:
        self.events.append(event)

    def check(self) -> None:
        """Do nothing: all is well."""

    def write(self, outputs: Mapping[str, float]) -> None:
        self.written.append(outputs)

    def off(self, wanted: Mapping[str, float]) -> list[str]:
        return [] if wanted == self.written[-1] else list(wanted)

    def wait(self, done: Callable[[], bool], timeout_s: float, state: str, action: str) -> None:
        assert done(), state

    def tracking(
        self, start_position: float, settle_s: float, setpoint: NDArray[np.float64]
    ) -> Wire:
        self.started.append((start_position, setpoint))
        return Wire(setpoint, self.fails)

    @contextmanager
    def reporting_stops(self) -> Iterator[None]:
        try:
            yield
        except LoopStoppedError as error:
            raise TripError(f"stopped: {error}") from None


@pytest.fixture
def rig() -> ConnectedRig:
    return ConnectedRig()


def motions(rig: ConnectedRig) -> Strokes:
    return Strokes(cast(Any, rig))


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_a_stroke_is_slow_and_steady_and_well_within_the_limits(
    rig: ConnectedRig, direction: float
) -> None:
    motions(rig).stroke(direction)
    ((start, setpoint),) = rig.started
    speeds = direction * np.diff(setpoint) / TICK
    assert np.allclose(speeds, speeds[0], rtol=1e-6)
    assert 0.9 * SPEED <= speeds[0] <= 1.1 * SPEED
    assert setpoint[0] == start
    assert setpoint.size == round(STROKE_S / TICK)
    assert setpoint.min() >= RIG.limits.position_min_m + 0.05
    assert setpoint.max() <= RIG.limits.position_max_m - 0.05


def test_a_short_rig_makes_shorter_and_slower_strokes(
    rig: ConnectedRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    limits = SimpleNamespace(position_min_m=0.1, position_max_m=0.3)
    monkeypatch.setattr(
        rig, "configured", SimpleNamespace(limits=limits, loop=RIG.loop), raising=False
    )
    motions(rig).stroke(1.0)
    assert np.ptp(rig.started[0][1]) == pytest.approx(0.1)


def test_at_rest_the_ram_is_held_in_the_middle(rig: ConnectedRig) -> None:
    motions(rig).rest(2.0)
    ((_, setpoint),) = rig.started
    middle = 0.5 * (RIG.limits.position_min_m + RIG.limits.position_max_m)
    assert np.array_equal(setpoint, np.full(2000, middle))


def test_what_was_read_comes_by_its_channel_from_every_tick(rig: ConnectedRig) -> None:
    samples = motions(rig).rest(1.0)
    ticks = np.arange(1000)[:, np.newaxis]
    assert np.allclose(samples.flows, ticks + np.array([0.2, 0.3, 0.4]))
    assert np.allclose(samples.pressures, ticks + np.array([0.5, 0.1]))


def test_the_state_machine_is_asked_for_every_step(rig: ConnectedRig) -> None:
    motions(rig).stroke(1.0)
    assert rig.events == [Event.POSITION, Event.POSITIONED, Event.RUN, Event.DONE]


def test_a_motion_that_the_loop_ends_is_no_measurement(rig: ConnectedRig) -> None:
    rig.fails = LoopStoppedError(Action.HOLD, Cause.LIMIT_HIGH, "position_m")
    with pytest.raises(TripError, match="stopped: hold"):
        motions(rig).stroke(1.0)
    assert Event.DONE not in rig.events


def test_a_bypass_is_opened_by_ball_and_needle_and_all_are_shut(rig: ConnectedRig) -> None:
    motions(rig).open_bypass("internal_leakage", 0.3)
    assert rig.written == [{"internal_leakage_ball": 1.0, "internal_leakage_needle": 0.3}]
    motions(rig).shut_bypasses()
    assert set(rig.written[-1].values()) == {0.0}
    assert {f"{kind}_ball" for kind in RIG.bypass_valves} <= rig.written[-1].keys()
