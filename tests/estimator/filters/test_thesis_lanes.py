"""The thesis's filters in lanes come to the bits that each comes to alone."""

import numpy as np
import pytest

from estimator.filters.registry import run_filter
from estimator.filters.thesis_lanes import Thesis7Lanes
from rig.lanes import LANES
from rig.loop.lanes import SimulatedLanes
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK

pytestmark = pytest.mark.long


def test_each_lane_estimates_as_alone() -> None:
    ticks = 1500
    time_s = np.linspace(0.0, ticks * TICK, ticks, endpoint=False)
    setpoint = np.stack([0.3 + 0.02 * i * np.sin(6.0 * time_s) for i in range(LANES)], axis=1)
    rigs = SimulatedLanes([NOMINAL] * LANES, range(LANES), [0.3] * LANES)
    readings = rigs.advance(setpoint, np.zeros_like(setpoint))
    filters = Thesis7Lanes(Model())
    states = np.concatenate([filters.advance(readings[:700]), filters.advance(readings[700:])])
    for lane in range(LANES):
        one = np.ascontiguousarray(readings[:, :, lane])
        alone = run_filter(time_s, one[:, 5], one[:, :5], Model(), "thesis-7").states
        assert np.array_equal(states[:, :, lane], alone)
