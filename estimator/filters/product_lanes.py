"""The product filters of several independent rigs at once, one in each lane (`rig.lanes`).

All lanes advance together in one common step. That is valid for a lane whose sample is ordinary:
position, pressures and spool are measured and within their ranges, and neither chamber is dry. A
lane with any other sample, or with the sample that ends a window of
`estimator.filters.divergence`, is advanced on its own by `product_step`.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import (
    LANES,
    align_stack,
    aligned,
    empty_lanes,
    everywhere,
    in_lanes,
    load,
    select,
    store,
)
from rig.plant import DATA_SHEET, Model, Parameters, SensorParameters, inlined, inner

from .divergence import READINGS, RESETS, SQUARES, SUPPLY, TICKS, WINDOW, take_innovation
from .product import WORK_SHAPE, confine, predict, product_step, start_product
from .product_model import DYNAMIC, STATE_COUNT
from .product_noise import DRY, ProductNoise, product_noise
from .readings import true_position, true_pressures
from .registry import OUTPUTS
from .ud import correct

Array = NDArray[np.float64]

_WATCHED: Final = WORK_SHAPE[1]
_COLUMNS: Final = 10
# Indices of the rows of a sample.
_POSITION: Final = 0
_P1: Final = 1
_P2: Final = 2
_SPOOL: Final = 3
_SUPPLY: Final = 4
_COMMAND: Final = 5


class _Memory(NamedTuple):
    """The memory of all filters between samples, and scratch arrays."""

    x: Array
    """States (11, LANES); NaN where a filter has not started yet."""
    factors: Array
    """Factors of the covariances (11, 11, LANES), as in `estimator.filters.ud`."""
    watch: Array
    """Memory of `estimator.filters.divergence`, (11, LANES)."""
    held: Array
    """Command in V held since the last sample, (1, LANES)."""
    x_one: Array
    """Scratch (LANES, 11): states of filters that are advanced on their own."""
    factors_one: Array
    """Scratch (LANES, 11, 11): factors of filters that are advanced on their own."""
    work_one: Array
    """Scratch (LANES, *WORK_SHAPE): `work` of filters that are advanced on their own."""
    jacobian: Array
    """Scratch (6, 11, LANES) of the common step."""
    rows: Array
    """Scratch (6, 10, LANES) of the common step."""
    vector: Array
    """Scratch (11, LANES) of the common step."""


@inlined
def _within(reading, lower, upper):
    return (reading > lower) & (reading < upper)


@inlined
def _is_ordinary(x, watch, position, p1, p2, spool, ranges):
    """Return in which lanes a sample is ordinary, apart from the ranges of the pressure readings.

    Position (m), pressures (Pa) and spool (m) are true values; `_in_transducers_range` judges the
    readings. No sample is ordinary that ends a window of `estimator.filters.divergence`, or that
    comes before its filter has started.
    """
    wet = max(ranges.pressure_min, DRY)
    return (
        _within(position, ranges.position_min, ranges.position_max)
        & (p1 >= wet) & (p2 >= wet)
        & _within(spool, -ranges.spool, ranges.spool)
        & (watch[TICKS] + 1.0 < WINDOW)
        & (x[3] == x[3])
    )  # fmt: skip


@inlined
def _in_transducers_range(p1, p2, ranges):
    """Return in which lanes both pressure readings (Pa) are within their transducers' range."""
    lower, upper = ranges.pressure_min, ranges.pressure_max
    return _within(p1, lower, upper) & _within(p2, lower, upper)


@inlined
def _take_all(memory, position, p1, p2, spool, supply, par, noise):
    """Advance the filters of all lanes by one sample, in place, as if it were ordinary in each.

    The caller must put another state into the lanes in which it is not. Position (m), pressures
    (Pa) and spool (m) are true values. The supply pressure (Pa) is as measured; where it is NaN or
    out of range, the last one holds.
    """
    x, factors, watch = in_lanes(memory.x), in_lanes(memory.factors), in_lanes(memory.watch)
    vector, ranges = in_lanes(memory.vector), noise.ranges
    known = _within(supply, ranges.pressure_min, ranges.pressure_max)
    watch[SUPPLY] = select(known, supply, watch[SUPPLY])
    predict(x, factors, load(memory.held, 0), watch[SUPPLY], par, noise, in_lanes(memory.jacobian),
            in_lanes(memory.rows), vector)  # fmt: skip
    take_innovation(watch, correct(x, factors, 0, spool, noise.spool, vector))
    take_innovation(watch, correct(x, factors, 3, position, noise.position, vector))
    take_innovation(watch, correct(x, factors, 1, p1, noise.pressure, vector))
    take_innovation(watch, correct(x, factors, 2, p2, noise.pressure, vector))
    watch[TICKS] += 1.0
    confine(x, ranges)


@inner
def _copy_lane(lane, memory):
    for i in range(STATE_COUNT):
        memory.x_one[lane, i] = memory.x[i, lane]
        memory.work_one[lane, 0, i] = memory.watch[i, lane]
        for j in range(STATE_COUNT):
            memory.factors_one[lane, i, j] = memory.factors[i, j, lane]


@inner
def _put_back(lane, memory):
    for i in range(STATE_COUNT):
        memory.x[i, lane] = memory.x_one[lane, i]
        memory.watch[i, lane] = memory.work_one[lane, 0, i]
        for j in range(STATE_COUNT):
            memory.factors[i, j, lane] = memory.factors_one[lane, i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def product_lane_ticks(memory, readings, par, noise, states):
    """Run the product filters of `LANES` rigs over the samples after their first ones.

    Args:
        memory: `_Memory`, updated.
        readings: (ticks, 6, LANES), SI: position, pressures 1 and 2, spool, supply pressure, and
            the command in V that is held from this sample on.
        par: `Parameters` that all filters assume.
        noise: `ProductNoise` that all filters assume.
        states: (ticks, 11, LANES), filled with the estimates after each sample.
    """
    align_stack()
    out = np.empty(len(OUTPUTS))
    ordinary = np.empty((1, LANES))
    for k in range(readings.shape[0]):
        z = readings[k]
        position = true_position(load(z, _POSITION), par)
        p1, p2 = true_pressures(load(z, _P1), load(z, _P2), par)
        spool, supply = load(z, _SPOOL), load(z, _SUPPLY)
        usual = _is_ordinary(
            in_lanes(memory.x), in_lanes(memory.watch), position, p1, p2, spool, noise.ranges
        )
        usual = usual & _in_transducers_range(load(z, _P1), load(z, _P2), noise.ranges)
        alone = not everywhere(usual)
        if alone:
            store(ordinary, 0, select(usual, 1.0, 0.0))
            for lane in range(LANES):
                if ordinary[0, lane] == 0.0:
                    _copy_lane(lane, memory)
        _take_all(memory, position, p1, p2, spool, supply, par, noise)
        if alone:
            for lane in range(LANES):
                if ordinary[0, lane] == 0.0:
                    product_step(
                        memory.x_one[lane], memory.factors_one[lane], memory.held[0, lane],
                        (z[_POSITION, lane], z[_P1, lane], z[_P2, lane], z[_SPOOL, lane],
                         z[_SUPPLY, lane]),
                        par, noise, memory.work_one[lane], out,
                    )  # fmt: skip
                    _put_back(lane, memory)
        for i in range(STATE_COUNT):
            store(states[k], i, load(memory.x, i))
        store(memory.held, 0, load(z, _COMMAND))


def _zeros(*rows: int) -> Array:
    """Return an array of zeros whose rows of lanes lie along cache lines, (*rows, LANES)."""
    return aligned(np.zeros((*rows, LANES)))


class ProductLanes:
    """The product filters of `LANES` rigs that all assume one model.

    Args:
        model: the model that the filters assume.
        sensors: data sheet of the transducers.

    Raises:
        ValueError: the model has a command delay, valve hysteresis or supply droop, which filters
            in lanes do not support.
    """

    def __init__(self, model: Model, sensors: SensorParameters = DATA_SHEET) -> None:
        for field in ("command_delay", "valve_hysteresis", "supply_droop"):
            if getattr(model.parameters, field) != 0.0:
                raise ValueError(
                    f"model: filters in lanes do not take {field}; run them one by one"
                )
        self._parameters: Parameters = model.parameters
        self._noise: ProductNoise = product_noise(sensors, model.parameters)
        self._memory = _Memory(
            x=_zeros(STATE_COUNT),
            factors=_zeros(STATE_COUNT, STATE_COUNT),
            watch=_zeros(_WATCHED),
            held=_zeros(1),
            x_one=np.zeros((LANES, STATE_COUNT)),
            factors_one=np.zeros((LANES, STATE_COUNT, STATE_COUNT)),
            work_one=np.zeros((LANES, *WORK_SHAPE)),
            jacobian=_zeros(DYNAMIC, STATE_COUNT),
            rows=_zeros(DYNAMIC, _COLUMNS),
            vector=_zeros(STATE_COUNT),
        )
        self._started = False

    @property
    def resets(self) -> NDArray[np.int64]:
        """Return how often each filter was found lost and has started anew: (LANES,)."""
        return self._memory.watch[RESETS].astype(np.int64)

    @property
    def squares(self) -> Array:
        """Return for each lane the mean of squared innovation over expected variance: (LANES,).

        The mean covers the readings of the present window so far. A window has 500 samples, half a
        second; the sample that starts the filter belongs to none, and a reset begins a new one. The
        window's sums are cleared with its last sample, so that the mean is 0 right after it: read
        it one sample before. No single reading counts for more than `divergence.LARGEST`.
        """
        watch = self._memory.watch
        return np.asarray(watch[SQUARES] / np.maximum(watch[READINGS], 1.0))

    def _start(self, sample: Array) -> None:
        memory = self._memory
        for lane in range(LANES):
            *reading, command = sample[:, lane]
            start_product(
                memory.x_one[lane], memory.factors_one[lane], command, tuple(reading),
                self._parameters, self._noise, memory.work_one[lane],
            )  # fmt: skip
        memory.x[:] = memory.x_one.T
        memory.factors[:] = np.moveaxis(memory.factors_one, 0, -1)
        memory.watch[:] = memory.work_one[:, 0].T
        memory.held[0] = sample[_COMMAND]
        self._started = True

    def advance(self, readings: Array, states: Array | None = None) -> Array:
        """Advance all filters by some samples and return the estimates.

        Args:
            readings: float64 (ticks, 6, LANES), SI, rows as `rig.loop.lane_ticks.LANE_READINGS`:
                five readings, of which a NaN is skipped, and the command in V from then on, which
                must be finite. The very first sample starts the filters.
            states: array for the result, (ticks, 11, LANES); None makes one.

        Returns:
            float64 (ticks, 11, LANES), rows as `estimator.filters.product_model.STATES`; NaN in a
            lane until its position and both pressures have been measured at once.
        """
        ticks = readings.shape[0]
        if states is None:
            states = empty_lanes(ticks * STATE_COUNT).reshape((ticks, STATE_COUNT, LANES))
        first = 0 if self._started else 1
        if not self._started:
            self._start(readings[0])
            states[0] = self._memory.x
        product_lane_ticks(
            self._memory, readings[first:], self._parameters, self._noise, states[first:]
        )
        return states
