"""Product filters in lanes come to what each comes to alone, whatever is wrong with its samples."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.product_lanes import ProductLanes
from estimator.filters.registry import FilterRun, run_filter
from rig.lanes import LANES
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from tools.simulated.lanes import SimulatedLanes

pytestmark = pytest.mark.long

Array = NDArray[np.float64]

TICKS = 2500


@pytest.fixture(scope="module")
def readings() -> Array:
    """Samples of rigs of which one strikes a stroke end, two lack readings, and one is lost."""
    t = np.arange(TICKS) * TICK
    setpoint = np.stack([0.3 + 0.02 * (i + 1) * np.sin(4.0 * t) for i in range(LANES)], axis=1)
    open_loop = np.zeros_like(setpoint)
    # Full strokes against an end and back empty a chamber.
    setpoint[:, 1], open_loop[:, 1] = np.where(np.sin(9.0 * t) > 0.0, 10.0, -10.0), 1.0
    rigs = [NOMINAL._replace(spool_null_bias=1e-6 * i) for i in range(LANES)]
    found = SimulatedLanes(rigs, range(LANES), [0.5] * LANES).advance(setpoint, open_loop)
    found[300:340, 0, 2] = np.nan
    found[700, 1:3, 2] = np.nan
    found[:, 3, 3] = np.nan
    found[1000:1010, 4, 4] = np.nan
    found[1200:, 1, 5] += 4e6
    found[:5, 0, 6] = np.nan
    found[900:950, 2, 7] = 2.07e7
    return found


def alone(readings: Array, lane: int) -> FilterRun:
    one = np.ascontiguousarray(readings[:, :, lane])
    time_s: Array = np.linspace(0.0, TICKS * TICK, TICKS, endpoint=False)
    return run_filter(time_s, one[:, 5], one[:, :5], Model())


@pytest.mark.parametrize("lane", range(LANES))
def test_each_lane_estimates_as_alone(readings: Array, lane: int) -> None:
    states = ProductLanes(Model()).advance(readings)[:, :, lane]
    expected = alone(readings, lane).states
    assert np.array_equal(states, expected, equal_nan=True)


def test_the_samples_are_as_bad_as_this_test_wants_them(readings: Array) -> None:
    assert (readings[:, 1:3, 1] < 1e5).any()
    assert alone(readings, 5).reset_times_s.size > 0
    assert np.isnan(alone(readings, 6).states[:5]).all()


def test_it_makes_no_difference_how_samples_are_batched(readings: Array) -> None:
    whole = ProductLanes(Model()).advance(readings)
    filters = ProductLanes(Model())
    parts = [filters.advance(readings[k : k + 333]) for k in range(0, TICKS, 333)]
    assert np.array_equal(whole, np.concatenate(parts), equal_nan=True)
