"""Keeps an oil account of each chamber: what the valve should have let in, less where it went.

Integrated over a block of half a second (longer while a chamber is dry), eq. 2.3 balances without
friction, load or acceleration:

    valve flow in = swept volume + compression + leaks.

What is missing is a leak, or an error of the model. The account of a block is therefore one row
per chamber, with the missing flow and, beside it, how it would look if each leak, or each known
weakness of the model, were there. Measured noise is small here: one encoder count in half a second
is 0.002 L/min. That is what makes small leaks visible (docs/decisions/0006-oil-account.md).
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant import Parameters
from rig.plant.dynamics import chamber_volumes, signed_root, valve_conductance
from rig.plant.integrator import TICK

from .product import DRY

Array = NDArray[np.float64]

BLOCK_TICKS: Final = 500
BLOCK_S: Final = BLOCK_TICKS * TICK

_LONGEST: Final = 16 * BLOCK_TICKS
"""Cavities open and close again, so an account is only drawn up when neither chamber is dry; until
then its block grows, by half a second at a time, and is given up after 8 s."""


class Nuisance(NamedTuple):
    """A known weakness of the model: its size (one standard deviation) before any data is seen."""

    name: str
    sigma: float
    unit: str
    source: str


NUISANCES: Final = (
    Nuisance("spool_null_bias", 1e-5, "m", "section 3.2.1: 9.8e-6 m on the thesis's rig"),
    Nuisance("valve_overlap", 3e-6, "m", "edge tolerance of a servovalve spool"),
    Nuisance("discharge_coefficient", 0.05, "", "tolerance of 5 % (docs/model.md)"),
    Nuisance("edge_supply_1", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_return_1", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_return_2", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_supply_2", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("supply_pressure", 6.9e5, "Pa", "tolerance of 5 % (docs/model.md)"),
    Nuisance("pressure_1_bias", 1e5, "Pa", "0.5 % of a 20.7 MPa transducer"),
    Nuisance("pressure_2_bias", 1e5, "Pa", "0.5 % of a 20.7 MPa transducer"),
    Nuisance("return_pressure", 1e5, "Pa", "head and filter of the return line at rest"),
    Nuisance("return_back_pressure", 2e12, "Pa/(m^3/s)^2", "0.3 MPa at rated flow"),
    Nuisance("supply_droop", 2e12, "Pa/(m^3/s)^2", "0.3 MPa at rated flow"),
    Nuisance("spool_delay", 2e-3, "s", "valve bandwidth or spool sensor lag"),
    Nuisance("bulk_modulus", 0.15, "", "tolerance of 15 % (docs/model.md)"),
)
NUISANCE_COUNT: Final = len(NUISANCES)
_SIGMA: Final = tuple(nuisance.sigma for nuisance in NUISANCES)

FAULTS: Final = (
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
)
FAULT_COUNT: Final = len(FAULTS)

_HEAD: Final = 5
# One row of sums: time, good ticks, ticks, two balances, nuisances and faults by chamber, sizes.
_WIDTH: Final = _HEAD + 2 * NUISANCE_COUNT + 3 * FAULT_COUNT
_CARRIED: Final = 5


@dataclass(frozen=True)
class AccountBlock:
    """The account of both chambers over half a second or more; flows in m^3/s, block averages.

    Attributes:
        start_s, end_s: time of the last sample before the block, and of its last.
        missing: float64 (2,), flow that entered by the valve's law and is nowhere to be found.
        nuisances: float64 (2, 15), missing flow per standard deviation of each of `NUISANCES`.
        faults: float64 (2, 5), missing flow per unit coefficient of each of `FAULTS` (SI; for
            supply leakage per Pa of lost supply pressure).
        sizes: float64 (5,), mean absolute flow per unit coefficient.
        complete: whether enough of the block's samples were measured.
    """

    start_s: float
    end_s: float
    missing: Array
    nuisances: Array
    faults: Array
    sizes: Array
    complete: bool


@njit(cache=True, error_model="numpy")
def _tick(spool, spool_rate, null_bias, p1, p2, par, row):
    """Add one sample's flows and signatures to the sums in `row`.

    The estimated null bias only tells which edges are open; its flow is left to the nuisance, so
    that a leak cannot hide in it.
    """
    supply, back = par.supply_pressure, par.return_pressure
    conductance = valve_conductance(par)
    flow = conductance * spool
    extending = spool + null_bias >= 0.0
    drop_1 = supply - p1 if extending else p1 - back
    drop_2 = p2 - back if extending else supply - p2
    root_1, root_2 = signed_root(drop_1), signed_root(drop_2)
    q1, q2 = flow * root_1, flow * root_2
    # Slope of the flow with its pressure drop; 0.1 MPa keeps it finite where the drop vanishes.
    slope_1 = 0.5 * q1 / max(drop_1, 1e5)
    slope_2 = 0.5 * q2 / max(drop_2, 1e5)
    row[3] += q1
    row[4] -= q2
    side = 1.0 if extending else -1.0

    # By how much the account would miss oil if the rig had one more unit of each than the model.
    n = _HEAD
    row[n] -= conductance * root_1
    row[n + 1] += conductance * root_2
    row[n + 2] += conductance * root_1 * side
    row[n + 3] -= conductance * root_2 * side
    row[n + 4] -= q1
    row[n + 5] += q2
    if extending:
        row[n + 6] -= q1
        row[n + 11] += q2
        row[n + 14] -= slope_1
        row[n + 16] -= slope_1
        row[n + 19] -= slope_2
        row[n + 21] -= slope_2
        row[n + 23] -= slope_2 * q2 * q2
        row[n + 24] += slope_1 * q1 * q1
    else:
        row[n + 8] -= q1
        row[n + 13] += q2
        row[n + 15] += slope_2
        row[n + 16] += slope_1
        row[n + 19] += slope_2
        row[n + 20] += slope_1
        row[n + 22] += slope_1 * q1 * q1
        row[n + 25] -= slope_2 * q2 * q2
    row[n + 26] -= conductance * root_1 * spool_rate
    row[n + 27] += conductance * root_2 * spool_rate

    f = _HEAD + 2 * NUISANCE_COUNT
    e1, e2, e12 = signed_root(p1 - back), signed_root(p2 - back), signed_root(p1 - p2)
    row[f] += e1
    row[f + 3] += e2
    row[f + 4] += e12
    row[f + 5] -= e12
    if extending:
        row[f + 6] += slope_1
        row[f + 9] += -slope_2 * q2 * q2
    else:
        row[f + 7] -= slope_2
        row[f + 8] += slope_1 * q1 * q1
    g = f + 2 * FAULT_COUNT
    row[g] += abs(e1)
    row[g + 1] += abs(e2)
    row[g + 2] += abs(e12)
    row[g + 3] += abs(slope_1) if extending else abs(slope_2)
    row[g + 4] += abs(slope_2 * q2 * q2) if extending else abs(slope_1 * q1 * q1)


@njit(cache=True, error_model="numpy")
def _accumulate(time_s, spool, null_bias, p1, p2, position, fresh, par, carried, row, rows):
    """Add samples to the running block `row`; move finished blocks to `rows`, return their number.

    `carried` keeps (samples in the block, last spool, p1, p2, position) between calls; samples are
    -1 while no block can begin, for want of a sample before it or because a chamber is dry.
    """
    finished = 0
    for k in range(time_s.size):
        dry = min(p1[k], p2[k]) < DRY
        if carried[0] >= 0.0:
            v1, v2 = chamber_volumes(0.5 * (position[k] + carried[4]), par)
            swept = par.piston_area * (position[k] - carried[4]) / TICK
            squeezed_1 = v1 / par.bulk_modulus * (p1[k] - carried[2]) / TICK
            squeezed_2 = v2 / par.bulk_modulus * (p2[k] - carried[3]) / TICK
            middle = 0.5 * (spool[k] + carried[1])
            rate = (spool[k] - carried[1]) / TICK
            oil_1, oil_2 = 0.5 * (p1[k] + carried[2]), 0.5 * (p2[k] + carried[3])
            _tick(middle, rate, null_bias[k], oil_1, oil_2, par, row)
            row[3] -= swept + squeezed_1
            row[4] += swept - squeezed_2
            last = _HEAD + 2 * (NUISANCE_COUNT - 1)
            row[last] -= squeezed_1
            row[last + 1] -= squeezed_2
            row[1] += fresh[k]
            carried[0] += 1.0
            if carried[0] % BLOCK_TICKS == 0 and (not dry or carried[0] == _LONGEST):
                rows[finished] = row / carried[0]
                rows[finished, 0] = time_s[k]
                rows[finished, 1] = 0.0 if dry else rows[finished, 1]
                rows[finished, 2] = carried[0]
                row[:] = 0.0
                carried[0] = -1.0 if dry else 0.0
                finished += 1
        elif not dry:
            carried[0] = 0.0
        carried[1], carried[2], carried[3], carried[4] = spool[k], p1[k], p2[k], position[k]
    return finished


class FlowAccount:
    """Accumulates samples into `AccountBlock`s, any number of samples at a time."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._carried = np.zeros(_CARRIED)
        self._carried[0] = -1.0
        self._row = np.zeros(_WIDTH)

    def add(
        self,
        time_s: Array,
        spool: Array,
        null_bias: Array,
        p1: Array,
        p2: Array,
        position: Array,
        fresh: Array,
    ) -> list[AccountBlock]:
        """Add samples (float64 (n,) each, SI, the filter's estimates) and return finished blocks.

        `fresh` is 1 where position and both pressures were measured in range, else 0; a block
        counts as complete when nine tenths of its samples were.
        """
        rows = np.empty((time_s.size // BLOCK_TICKS + 1, _WIDTH))
        count = _accumulate(time_s, spool, null_bias, p1, p2, position, fresh, self._parameters,
                            self._carried, self._row, rows)  # fmt: skip
        return [self._block(row) for row in rows[:count]]

    @staticmethod
    def _block(row: Array) -> AccountBlock:
        f = _HEAD + 2 * NUISANCE_COUNT
        nuisances = row[_HEAD:f].reshape(NUISANCE_COUNT, 2).T * np.array(_SIGMA)
        faults = row[f : f + 2 * FAULT_COUNT].reshape(FAULT_COUNT, 2).T
        return AccountBlock(
            start_s=float(row[0] - row[2] * TICK),
            end_s=float(row[0]),
            missing=row[3:5].copy(),
            nuisances=nuisances.copy(),
            faults=faults.copy(),
            sizes=row[f + 2 * FAULT_COUNT :].copy(),
            complete=bool(row[1] >= 0.9),
        )


def reference_drop(parameters: Parameters, fault: str) -> float:
    """Return the pressure drop in Pa at which a leak's flow is quoted.

    Half the supply pressure; for internal leaks, what a ram that moves slowly against its friction
    needs, half as much again as the slip friction (table 2.1).
    """
    if fault == "internal_leakage":
        return 1.5 * parameters.coulomb / parameters.piston_area
    return 0.5 * (parameters.supply_pressure - parameters.return_pressure)


def reference_flow(parameters: Parameters, fault: str, coefficient: float) -> float:
    """Return the flow in m^3/s that a leak coefficient (SI) passes at that drop (eq. 5.2)."""
    return coefficient * sqrt(reference_drop(parameters, fault))
