"""The leak test on hardware: a session that arms and homes a rig, tests it, and leaves it safe."""

from collections.abc import Callable
from pathlib import Path

from estimator.filters import DEFAULT_FILTER
from estimator.leak_test import Soak
from rig.configuration import Rig, foreseen_leaks
from rig.plant import LITRE_PER_MINUTE, Model, valve_conductance
from rig.supervisor import ConnectedRig, LockedRig, Onlooker, Session, Stop

from .results import LeakTest
from .sequence import run_leak_test


def could_see(rig: Rig, assumed: Model) -> str:
    """Return in words the smallest leaks that 95 of 100 tests of a rig on hardware will find.

    All that a test computes is compiled by this, so that nothing is compiled while the rig is
    armed.

    Args:
        rig: a rig with blocking valves.
        assumed: what is assumed of it.
    """
    valve_conductance(assumed.parameters)
    smallest = (f"{value / LITRE_PER_MINUTE:.5f}" for value in foreseen_leaks(rig, assumed))
    return f"could see {', '.join(smallest)} L/min: chamber 1, chamber 2, across the piston"


def run_connected_leak_test(
    rig: Rig,
    assumed: Model,
    directory: Path,
    stop: Stop,
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
