"""Runs tests on simulated rigs in this process, with a new rig for each test."""

import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from estimator.filters import FilterMemory
from faults import CampaignTest, FaultSchedule, SpringLoad
from rig.channels import READINGS
from rig.configuration import Rig
from rig.io import HomingSettings, simulated_rig
from rig.loop import Interlock, Motion, Reaction, SimulatedLoop, interlock, limit_table, tolerances
from rig.plant import TICK, Model, Parameters
from rig.recording import McapWriter

from .simulated_loop import SimulatedTest


class SimulatedBench:
    """A `Bench` that simulates a new rig for each test.

    Args:
        rig: the rig to simulate.
        directory: folder of the run, to which a trip report is written.
        say: shows a line to the operator.
    """

    live = False

    def __init__(
        self, rig: Rig, directory: Path, say: Callable[[str], None] = lambda line: None
    ) -> None:
        self._rig = rig
        self._say = say
        self._directory = directory
        self._test: SimulatedTest | None = None

    def __enter__(self) -> "SimulatedBench":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> SimulatedTest:
        """Return the loop of a test on a new simulated rig, which only this test uses."""
        loop = loop_of(self._rig, test, memory, assumed)
        self._test = SimulatedTest(loop, self._directory, self._rig.ladder, self._say)
        return self._test

    def reading(self, channel: str) -> float | None:
        """Return the newest value of a channel in the latest test.

        It is NaN if the rig has no such channel, and None before the test's first row and after
        `idle`.
        """
        return None if self._test is None else self._test.latest(channel)

    def idle(self) -> None:
        """Forget the last test's rig, as there is no rig between two tests."""
        self._test = None

    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> McapWriter:
        """Return the writer of a test's recording."""
        return McapWriter(path, channels, {**metadata, "start_ns": time.time_ns()})


def truth_of(rig: Rig, test: CampaignTest) -> Model:
    """Return the model that simulates a rig during a test: the rig's own with the test's load."""
    if test.load is None:
        return rig.plant
    stiffness, contact = test.load.stiffness, test.load.contact
    return rig.plant.with_effect("spring_load", stiffness=stiffness, contact=contact)


def motion_of(test: CampaignTest) -> Motion:
    """Return the setpoints and the faults of a test for every tick, as the loop runs them."""
    ticks = round(test.duration_s / TICK)
    return Motion(
        setpoint=np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK)),
        open_loop=test.setpoint.quantity == "command",
        faults=FaultSchedule(test.faults).table(ticks, TICK),
        start_position=test.start_position_m,
        settle_ticks=round(test.settle_s / TICK),
    )


def interlock_of(rig: Rig, assumed: Model) -> Interlock:
    """Return the interlock that judges the samples of a simulated rig, as it does on hardware.

    Args:
        rig: the simulated rig, with its limits.
        assumed: the model with which the samples must agree.
    """
    absent = {
        "spool_m": not rig.has_spool_sensor,
        "supply_pressure_Pa": not rig.has_supply_pressure_sensor,
        "load_N": not rig.has_load_cell,
    }
    fitted = frozenset(name for name in READINGS if not absent.get(name, False))
    judged = tolerances(
        assumed.parameters,
        rig.sensors,
        fitted,
        TICK,
        rig.loop.stale_limit,
        rig.homing or HomingSettings(),
        rig.limits.command_V,
    )
    return interlock(limit_table(rig.ladder, TICK), judged)


def _rest_position(par: Parameters, load: SpringLoad | None) -> float:
    """Return where a ram rests before its test, m: at mid stroke, but never inside a spring.

    A stiff spring would throw a ram that begins inside it farther in a tick than any valve can.
    """
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    return middle if load is None else min(middle, load.contact)


def loop_of(
    rig: Rig, test: CampaignTest, memory: FilterMemory, assumed: Model, *, judged: bool = True
) -> SimulatedLoop:
    """Return the simulated loop of a test, before the ram has moved to its start position.

    Args:
        rig: the rig to simulate.
        test: the test.
        memory: the filter's memory before its first sample.
        assumed: the model that filter and interlock assume.
        judged: whether the interlock judges the samples.
    """
    truth = truth_of(rig, test)
    simulated = simulated_rig(
        truth,
        test.seed,
        sensors=rig.sensors,
        spool_sensor=rig.has_spool_sensor,
        supply_pressure_sensor=rig.has_supply_pressure_sensor,
        load_cell=rig.has_load_cell,
        position=_rest_position(truth.parameters, test.load),
    )
    return SimulatedLoop(
        simulated,
        motion_of(test),
        memory,
        assumed.parameters,
        gain=rig.gain_V_per_m,
        limit=rig.limits.command_V,
        on_fault=Reaction[test.on_fault.name],
        interlock=interlock_of(rig, assumed) if judged else None,
    )
