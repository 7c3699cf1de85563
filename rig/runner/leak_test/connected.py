"""The leak test on hardware: a session that arms and homes a rig, tests it, and leaves it safe."""

from collections.abc import Callable
from pathlib import Path

from estimator.filters import DEFAULT_FILTER
from estimator.leak_test import BlockingLeak, Soak, foreseen_limits, levels_of
from rig.configuration import Rig
from rig.plant import TICK, Model, valve_conductance
from rig.runner import StopFlag
from rig.supervisor import PERIOD_TICKS, ConnectedRig, LockedRig, Onlooker, Session

from .results import LeakTest
from .sequence import run_leak_test


def foreseen(rig: Rig, assumed: Model) -> tuple[float, ...]:
    """Return the smallest leaks in m^3/s that 95 of 100 tests of a rig on hardware will find.

    They are in the order of `rig.plant.LEAKS`, for a ram at mid stroke. All that a test computes is
    compiled by this, so that nothing is compiled while the rig is armed.

    Args:
        rig: a rig with blocking valves.
        assumed: what is assumed of it.
    """
    valves, par = rig.blocking_valves, assumed.parameters
    if valves is None:
        raise ValueError(f"{rig.name} has no blocking valves")
    valve_conductance(par)
    blocking = BlockingLeak(valves.leak, valves.leak_pressure)
    middle = 0.5 * (rig.limits.position_min_m + rig.limits.position_max_m)
    rate_hz = 1.0 / (PERIOD_TICKS * TICK)
    return foreseen_limits(levels_of(par), par, rig.sensors, blocking, middle, rate_hz)


def run_connected_leak_test(
    rig: Rig,
    assumed: Model,
    directory: Path,
    stop: StopFlag,
    say: Callable[[str], None],
    onlooker: Onlooker,
    on_soak: Callable[[int, Soak], None],
) -> LeakTest:
    """Connect a rig, arm and home it, run the test at mid stroke, and leave the rig safe.

    Args:
        rig: a rig on hardware with blocking valves.
        assumed: what is assumed of it.
        directory: folder for a trip report.
        stop: the flag by which somebody asks for the end.
        say: shows a line to the operator.
        onlooker: is told of the session's progress.
        on_soak: is called with number, from 1, and samples of each soak after it.

    Raises:
        DriverError: a device does not answer, or is not the configured one.
        LeakTestError: a chamber did not keep its pressure, so that the test tells nothing.
        TripError: the rig tripped, or somebody asked for the end.
    """
    connected = ConnectedRig(rig, DEFAULT_FILTER, assumed, directory, stop, say, onlooker)
    with Session(connected):
        return run_leak_test(rig, assumed.parameters, LockedRig(connected), on_soak)
