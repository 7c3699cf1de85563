"""Rigs in lanes follow by the law by which each follows in the simulated loop."""

from dataclasses import replace
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from control import (
    Constant,
    ControlSettings,
    Guide,
    Multisine,
    Setpoint,
    Sine,
    Steps,
    Trapezoid,
    Triangle,
)
from estimator.filters import start_memory
from rig.configuration.rigs.rig import load_rig
from rig.lanes import LANES
from rig.loop.lane_ticks import LANE_READINGS
from rig.plant import DATA_SHEET, Model, Parameters
from rig.runner.campaign.bench import plain_test
from rig.runner.campaign.simulated_bench import loop_of
from tools.simulated.lanes import SimulatedLanes

Array = NDArray[np.float64]

TICKS: Final = 3000
GAIN: Final = 60.0
SILENT: Final = DATA_SHEET._replace(pressure_noise=0.0, spool_noise=0.0, supply_pressure_noise=0.0)
TRACKING: Final = ControlSettings(
    feedforward="model", null=0.05, deadband=0.2, integral_time=1.0, cyclic=True
)
FOLLOWED: Final[tuple[tuple[Setpoint, ControlSettings], ...]] = (
    (Sine(0.3, 0.1, 0.5), TRACKING),
    (Multisine(0.3, 0.1, (0.3, 0.7)), TRACKING),
    (Sine(0.3, 0.1, 0.5), ControlSettings()),
    (Triangle(0.3, 0.1, 0.4), TRACKING),
    (Steps((0.3, 0.32), 1.0), TRACKING),
    (Constant(0.3), TRACKING),
    (Trapezoid(0.3, 0.1, 0.3, 0.3), TRACKING),
    (Sine(0.0, 2.0, 1.0, quantity="command"), TRACKING),
)
LEARNING: Final = (0, 1)
"""Lanes whose setpoint has frequencies that are corrected; sines of lanes are right to 1e-9."""


class Alone:
    """The rigs of `FOLLOWED`, each run by a simulated loop of its own."""

    def __init__(self) -> None:
        self.rigs: list[Parameters] = []
        self.guides: list[Guide] = []
        self.setpoints: list[Array] = []
        self.positions: list[Array] = []
        self.commands: list[Array] = []
        base, model = load_rig("simulated"), Model()
        for lane in range(LANES):
            setpoint, settings = FOLLOWED[lane % len(FOLLOWED)]
            plant = base.plant.with_effect("spool_null_bias", value=4e-6 * (lane + 1))
            rig = replace(base, plant=plant, sensors=SILENT, control=settings, gain_V_per_m=GAIN)
            test = plain_test("alone", setpoint, TICKS * 1e-3, 0.3, 0.0, 1)
            memory = start_memory("product", model, SILENT)
            loop = loop_of(rig, test, memory, model, judged=False)
            self.start = float(loop.rig.state[4])
            self.rigs.append(plant.parameters)
            self.guides.append(loop.guide)
            self.setpoints.append(loop.motion.setpoint)
            rows = loop.advance(TICKS)
            self.positions.append(rows[:, loop.channels.index("position_m")])
            self.commands.append(rows[:, loop.channels.index("command_V")])


@pytest.fixture(scope="module")
def alone() -> Alone:
    return Alone()


def side_by_side(alone: Alone, batch: int) -> Array:
    """Return the readings of all rigs, run in lanes in batches of some ticks."""
    lanes = SimulatedLanes(
        alone.rigs, range(LANES), [alone.start] * LANES, sensors=SILENT, gain=GAIN,
        guides=alone.guides,
    )  # fmt: skip
    setpoint = np.stack(alone.setpoints, axis=1)
    is_open = [FOLLOWED[lane % len(FOLLOWED)][0].quantity == "command" for lane in range(LANES)]
    opened = np.tile(np.array(is_open, np.float64), (TICKS, 1))
    parts = range(0, TICKS, batch)
    found = [lanes.advance(setpoint[k : k + batch], opened[k : k + batch]) for k in parts]
    return np.concatenate(found)


def test_every_lane_goes_as_its_rig_does_in_the_simulated_loop(alone: Alone) -> None:
    readings = side_by_side(alone, TICKS)
    for lane in range(LANES):
        command = readings[:, LANE_READINGS.index("command_V"), lane]
        position = readings[:, LANE_READINGS.index("position_m"), lane]
        np.testing.assert_array_equal(position, alone.positions[lane])
        if lane % len(FOLLOWED) in LEARNING:
            np.testing.assert_allclose(command, alone.commands[lane], rtol=0.0, atol=1e-8)
        else:
            np.testing.assert_array_equal(command, alone.commands[lane])


def test_what_a_law_remembers_does_not_depend_on_the_batches(alone: Alone) -> None:
    np.testing.assert_array_equal(side_by_side(alone, TICKS), side_by_side(alone, 701))
