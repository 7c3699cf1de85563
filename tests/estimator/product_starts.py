"""Runs the product filter from any initial state, right or wrong."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from estimator.filters.divergence import READINGS, RESETS, SQUARES, SUPPLY
from estimator.filters.product import WORK_SHAPE, product_step
from estimator.filters.product_model import STATE_COUNT
from estimator.filters.product_noise import ProductNoise, product_noise
from estimator.filters.ud import dense_covariance
from rig.plant import NOMINAL, Parameters
from rig.plant.sensors import DATA_SHEET

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy")
def _stepped(
    x: Array,
    factors: Array,
    command: Array,
    readings: Array,
    par: Parameters,
    noise: ProductNoise,
    work: Array,
    states: Array,
    least: Array,
) -> None:
    out = np.empty(10)
    for k in range(1, command.size):
        z = readings[k]
        reading = (z[0], z[1], z[2], z[3], z[4])
        product_step(x, factors, command[k - 1], reading, par, noise, work, out)
        states[k] = x
        least[k] = factors[0, 0]
        for i in range(1, x.size):
            least[k] = min(least[k], factors[i, i])


class Steps(NamedTuple):
    """The result of a run of the product filter.

    Attributes:
        states: (n, 11) states, beginning with the initial one.
        least_variance: (n,) smallest entry of the factor D after every tick; inf in the first row.
        covariance: (11, 11) after the last tick.
        resets: how often the filter started anew.
        squares: sum of squared innovations over their variances, in the last window.
        readings: number of these innovations.
    """

    states: Array
    least_variance: Array
    covariance: Array
    resets: int
    squares: float
    readings: int


def from_start(
    x: Array, factors: Array, command: Array, readings: Array, par: Parameters = NOMINAL
) -> Steps:
    """Run the filter over readings (n, 5) and commands (n,) in V, from a given initial state.

    `x` (11,) is the state, and `factors` (11, 11) are the factors of its covariance; neither is
    changed. The first row of the readings is not used.
    """
    work, factors, n = np.zeros(WORK_SHAPE), factors.copy(), command.size
    work[0, SUPPLY] = par.supply_pressure
    states, least = np.zeros((n, STATE_COUNT)), np.full(n, np.inf)
    states[0] = x
    noise = product_noise(DATA_SHEET, par)
    _stepped(x.copy(), factors, command, readings, par, noise, work, states, least)
    covariance, watch = dense_covariance(factors), work[0]
    return Steps(
        states, least, covariance, int(watch[RESETS]), watch[SQUARES], int(watch[READINGS])
    )
