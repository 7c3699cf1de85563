"""The product filter of many independent rigs at once, one in each lane (`rig.lanes`).

A lane takes the common step while its sample is an ordinary one: all of position, pressures and
spool measured within their ranges, neither chamber dry. Any other sample, and the one that ends a
window of `estimator.filters.divergence`, it takes alone, by `product_step` itself.
"""

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.lanes import LANES, align_stack, everywhere, in_lanes, load, select, store
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
# Rows of a sample.
_POSITION: Final = 0
_P1: Final = 1
_P2: Final = 2
_SPOOL: Final = 3
_SUPPLY: Final = 4
_COMMAND: Final = 5


@inlined
def _within(reading, lower, upper):
    return (reading > lower) & (reading < upper)


@inlined
def _is_ordinary(x, watch, position, p1, p2, spool, ranges):
    """Return where a sample can be taken by the common step."""
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
    """Return where both pressures, as read, are within their transducers' range."""
    lower, upper = ranges.pressure_min, ranges.pressure_max
    return _within(p1, lower, upper) & _within(p2, lower, upper)


@inlined
def _take_all(x, factors, watch, command, position, p1, p2, spool, supply, par, noise,
              jacobian, rows, vector):  # fmt: skip
    """Take a sample in all lanes; the arrays are lanes (`in_lanes`)."""
    ranges = noise.ranges
    known = _within(supply, ranges.pressure_min, ranges.pressure_max)
    watch[SUPPLY] = select(known, supply, watch[SUPPLY])
    predict(x, factors, command, watch[SUPPLY], par, noise, jacobian, rows, vector)
    take_innovation(watch, correct(x, factors, 0, spool, noise.spool, vector))
    take_innovation(watch, correct(x, factors, 3, position, noise.position, vector))
    take_innovation(watch, correct(x, factors, 1, p1, noise.pressure, vector))
    take_innovation(watch, correct(x, factors, 2, p2, noise.pressure, vector))
    watch[TICKS] += 1.0
    confine(x, ranges)


@inner
def _copy_lane(lane, x, factors, watch, x_one, factors_one, work_one):
    for i in range(STATE_COUNT):
        x_one[lane, i] = x[i, lane]
        work_one[lane, 0, i] = watch[i, lane]
        for j in range(STATE_COUNT):
            factors_one[lane, i, j] = factors[i, j, lane]


@inner
def _put_back(lane, x, factors, watch, x_one, factors_one, work_one):
    for i in range(STATE_COUNT):
        x[i, lane] = x_one[lane, i]
        watch[i, lane] = work_one[lane, 0, i]
        for j in range(STATE_COUNT):
            factors[i, j, lane] = factors_one[lane, i, j]


@njit(cache=True, error_model="numpy", nogil=True)
def product_lane_ticks(
    x, factors, watch, held, readings, par, noise, x_one, factors_one, work_one,
    jacobian, rows, vector, states,
):  # fmt: skip
    """Run the product filter over samples of `LANES` rigs.

    Args:
        x: (11, LANES) states, updated; NaN where a filter has not had a sample yet.
        factors: (11, 11, LANES), as in `estimator.filters.ud`, updated.
        watch: (11, LANES), what `estimator.filters.divergence` keeps, updated.
        held: (LANES,) command since the last sample in V, updated.
        readings: (ticks, 6, LANES): position, pressures 1 and 2, spool, supply pressure, and the
            command from there on.
        par: `Parameters` that all filters assume.
        noise: `ProductNoise`.
        x_one: scratch (LANES, 11).
        factors_one: scratch (LANES, 11, 11).
        work_one: scratch (LANES, *WORK_SHAPE).
        jacobian: scratch (6, 11, LANES).
        rows: scratch (6, 10, LANES).
        vector: scratch (11, LANES).
        states: (ticks, 11, LANES), to be filled with the estimates.
    """
    align_stack()
    out = np.empty(len(OUTPUTS))
    ordinary = np.empty((1, LANES))
    all_x, all_factors, all_watch = in_lanes(x), in_lanes(factors), in_lanes(watch)
    all_held = held.reshape((1, LANES))
    for k in range(readings.shape[0]):
        z = readings[k]
        position = true_position(load(z, _POSITION), par)
        p1, p2 = true_pressures(load(z, _P1), load(z, _P2), par)
        spool, supply = load(z, _SPOOL), load(z, _SUPPLY)
        usual = _is_ordinary(all_x, all_watch, position, p1, p2, spool, noise.ranges)
        usual = usual & _in_transducers_range(load(z, _P1), load(z, _P2), noise.ranges)
        alone = not everywhere(usual)
        if alone:
            store(ordinary, 0, select(usual, 1.0, 0.0))
            for lane in range(LANES):
                if ordinary[0, lane] == 0.0:
                    _copy_lane(lane, x, factors, watch, x_one, factors_one, work_one)
        _take_all(all_x, all_factors, all_watch, load(all_held, 0), position, p1, p2, spool,
                  supply, par, noise, in_lanes(jacobian), in_lanes(rows),
                  in_lanes(vector))  # fmt: skip
        if alone:
            for lane in range(LANES):
                if ordinary[0, lane] == 0.0:
                    product_step(
                        x_one[lane], factors_one[lane], held[lane], z[_POSITION, lane],
                        z[_P1, lane], z[_P2, lane], z[_SPOOL, lane], z[_SUPPLY, lane], par, noise,
                        work_one[lane], out,
                    )  # fmt: skip
                    _put_back(lane, x, factors, watch, x_one, factors_one, work_one)
        for i in range(STATE_COUNT):
            store(states[k], i, load(x, i))
        store(all_held, 0, load(z, _COMMAND))


class ProductLanes:
    """The product filters of `LANES` rigs that all assume one model.

    Args:
        model: what the filters assume.
        sensors: data sheet of the transducers.

    Raises:
        ValueError: the model has a delay or a play of the command, or a supply droop: each filter
            would need a memory of its own.
    """

    def __init__(self, model: Model, sensors: SensorParameters = DATA_SHEET) -> None:
        for field in ("command_delay", "valve_hysteresis", "supply_droop"):
            if getattr(model.parameters, field) != 0.0:
                raise ValueError(
                    f"model: filters in lanes do not take {field}; run them one by one"
                )
        self._parameters: Parameters = model.parameters
        self._noise: ProductNoise = product_noise(sensors, model.parameters)
        self._x = np.zeros((STATE_COUNT, LANES))
        self._factors = np.zeros((STATE_COUNT, STATE_COUNT, LANES))
        self._watch = np.zeros((_WATCHED, LANES))
        self._held = np.zeros(LANES)
        self._alone = (
            np.zeros((LANES, STATE_COUNT)),
            np.zeros((LANES, STATE_COUNT, STATE_COUNT)),
            np.zeros((LANES, *WORK_SHAPE)),
        )
        self._scratch = (
            np.zeros((DYNAMIC, STATE_COUNT, LANES)),
            np.zeros((DYNAMIC, _COLUMNS, LANES)),
            np.zeros((STATE_COUNT, LANES)),
        )
        self._started = False

    @property
    def resets(self) -> NDArray[np.int64]:
        """How often each filter (LANES,) was found lost and has started anew."""
        return self._watch[RESETS].astype(np.int64)

    @property
    def squares(self) -> Array:
        """Return each lane's mean squared innovation, each over its expected variance: (LANES,).

        The mean covers the readings of the present window so far. A window has 500 samples, half a
        second; the sample that starts the filter belongs to none, and a reset begins a new one. The
        window's sums are cleared with its last sample, so that this is 0 right after it: read it
        one sample before. No single reading counts for more than `LARGEST`.
        """
        return np.asarray(self._watch[SQUARES] / np.maximum(self._watch[READINGS], 1.0))

    def _start(self, sample: Array) -> None:
        x, factors, work = self._alone
        for lane in range(LANES):
            position, p1, p2, spool, _, command = sample[:, lane]
            start_product(x[lane], factors[lane], position, p1, p2, spool, command,
                          self._parameters, self._noise, work[lane])  # fmt: skip
        self._x[:] = x.T
        self._factors[:] = np.moveaxis(factors, 0, -1)
        self._watch[:] = work[:, 0].T
        self._held[:] = sample[_COMMAND]
        self._started = True

    def advance(self, readings: Array) -> Array:
        """Take samples and return the estimates.

        Args:
            readings: float64 (ticks, 6, LANES), rows as `rig.loop.lane_ticks.LANE_READINGS`; NaN is
                skipped. The first sample ever starts the filters.

        Returns:
            float64 (ticks, 11, LANES), rows as `estimator.filters.product_model.STATES`.
        """
        states = np.empty((readings.shape[0], STATE_COUNT, LANES))
        first = 0 if self._started else 1
        if not self._started:
            self._start(readings[0])
            states[0] = self._x
        x_one, factors_one, work_one = self._alone
        jacobian, rows, vector = self._scratch
        product_lane_ticks(
            self._x, self._factors, self._watch, self._held, readings[first:], self._parameters,
            self._noise, x_one, factors_one, work_one, jacobian, rows, vector, states[first:],
        )  # fmt: skip
        return states
