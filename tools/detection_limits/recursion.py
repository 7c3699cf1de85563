"""The compiled recursion of the bound: the covariance of states and constants by sample."""

from math import sqrt
from typing import Final

import numpy as np

from estimator.filters.product_model import DYNAMIC, STATE_COUNT, predict_product
from rig.jit import njit

STEP: Final = 1e-3
"""Step of the central differences by a parameter, as a share of the parameter's tolerance."""


@njit(cache=True, error_model="numpy")
def advance_covariance(covariance, rows, product):
    """Replace P by F P F^T, where F is the identity except for its first m rows.

    Args:
        covariance: symmetric P (n, n); replaced in place.
        rows: the first rows of F (m, n).
        product: scratch array (m, n).
    """
    m, n = rows.shape
    for i in range(m):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += rows[i, k] * covariance[k, j]
            product[i, j] = total
    for i in range(m):
        for j in range(m, n):
            covariance[i, j] = covariance[j, i] = product[i, j]
        for j in range(i, m):
            total = 0.0
            for k in range(n):
                total += product[i, k] * rows[j, k]
            covariance[i, j] = covariance[j, i] = total


@njit(cache=True, error_model="numpy")
def observe(covariance, state, bias, variance, gain):
    """Update P by a reading, which is the sum of a state, a constant bias and noise.

    Args:
        covariance: symmetric P (n, n); updated in place.
        state: index of the state.
        bias: index of the bias; -1 if the reading has none.
        variance: variance of the reading's noise.
        gain: scratch array (n,).
    """
    n = covariance.shape[0]
    for i in range(n):
        gain[i] = covariance[i, state] + (covariance[i, bias] if bias >= 0 else 0.0)
    spread = gain[state] + (gain[bias] if bias >= 0 else 0.0) + variance
    for i in range(n):
        share = gain[i] / spread
        for j in range(i, n):
            covariance[i, j] -= share * gain[j]
            covariance[j, i] = covariance[i, j]


@njit(cache=True, error_model="numpy")
def leak_covariances(
    x, command, par, lower, upper, columns, flows, biases, supply, covariance, noise, spool, onset,
    reports, blocks,
):  # fmt: skip
    """Run the recursion over a course; write the leaks' covariance (3, 3) at the ticks `reports`.

    The unknowns are the 11 states of the product model, followed by the constants: first those that
    are parameters, then the biases of transducers, and last those that are inflows. Each constant
    is in units of its tolerance, except the biases.

    Args:
        x: true states of the product model (ticks, 11).
        command: (ticks,), V.
        par: `Parameters` of the rig.
        lower: for each constant that is a parameter, the parameters with `STEP` tolerances less.
        upper: the same with `STEP` tolerances more.
        columns: indices of these constants among the unknowns.
        flows: (ticks - 1, constants, 2), oil that the constants of the last kind let into the two
            chambers, m^3/s for one tolerance.
        biases: indices of the biases of the readings of spool, position and pressures 1 and 2; -1
            where there is none.
        supply: index of the constant that a supply-pressure transducer measures, or -1; and the
            variance of its noise in units of that constant.
        covariance: covariance (n, n) of all unknowns before any sample; updated in place.
        noise: `ProductNoise`.
        spool: whether the spool is measured.
        onset: tick from which on a leak may be present.
        reports: ticks at which the covariance is written, ascending.
        blocks: (reports, 3, 3), receives the leaks' covariances.
    """
    n = covariance.shape[0]
    first_flow = n - flows.shape[1]
    rows, product, gain = np.zeros((DYNAMIC, n)), np.empty((DYNAMIC, n)), np.empty(n)
    jacobian, unused = np.empty((DYNAMIC, STATE_COUNT)), np.empty((DYNAMIC, STATE_COUNT))
    low, high = np.empty(STATE_COUNT), np.empty(STATE_COUNT)
    report = 0
    for k in range(reports[-1] + 1):
        if k > 0:
            low[:] = x[k - 1]
            predict_product(low, command[k - 1], par.supply_pressure, par, jacobian)
            rows[:, :STATE_COUNT] = jacobian
            if k <= onset:
                rows[:, 7:10] = 0.0
            for j in range(columns.size):
                low[:] = x[k - 1]
                high[:] = x[k - 1]
                below, above = lower[j], upper[j]
                predict_product(low, command[k - 1], below.supply_pressure, below, unused)
                predict_product(high, command[k - 1], above.supply_pressure, above, unused)
                for i in range(DYNAMIC):
                    rows[i, columns[j]] = (high[i] - low[i]) / (2.0 * STEP)
            # A leak's column is the effect of an outflow of one root; an inflow has its negative.
            root_1 = sqrt(x[k - 1, 1] - par.return_pressure)
            root_2 = sqrt(x[k - 1, 2] - par.return_pressure)
            for j in range(flows.shape[1]):
                for i in range(DYNAMIC):
                    rows[i, first_flow + j] = -(
                        jacobian[i, 7] / root_1 * flows[k - 1, j, 0]
                        + jacobian[i, 8] / root_2 * flows[k - 1, j, 1]
                    )
            advance_covariance(covariance, rows, product)
            covariance[1, 1] += noise.chamber_pressure
            covariance[2, 2] += noise.chamber_pressure
            covariance[4, 4] += noise.velocity
            covariance[5, 5] += noise.spool_velocity
            covariance[6, 6] += noise.load
            covariance[10, 10] += noise.null_bias
        if spool:
            observe(covariance, 0, biases[0], noise.spool, gain)
        observe(covariance, 3, biases[1], noise.position, gain)
        observe(covariance, 1, biases[2], noise.pressure, gain)
        observe(covariance, 2, biases[3], noise.pressure, gain)
        if supply[0] >= 0:
            observe(covariance, supply[0], -1, supply[1], gain)
        if k == reports[report]:
            blocks[report] = covariance[7:10, 7:10]
            report += 1
