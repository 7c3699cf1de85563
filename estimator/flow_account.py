"""Keeps an oil account of each chamber: what the valve should have let in, less where it went.

Integrated over a block of half a second (longer while a chamber is dry), eq. 2.3 balances without
friction, load or acceleration:

    valve flow in = swept volume + compression + leaks.

What is missing is a leak, or an error of the model. The account of a block is therefore one row
per chamber, with the missing flow and, beside it, how it would look if each leak, or each known
weakness of the model, were there. Measured noise is small here: one encoder count in half a second
is 0.002 L/min. That is what makes small leaks visible (docs/decisions/0006-oil-account.md).
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant import NO_FAULT, Parameters
from rig.plant.dynamics import chamber_volumes, leak_flows, signed_root, valve_conductance
from rig.plant.integrator import TICK

from .product_noise import DRY

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
_SIGMA: Final = np.array([nuisance.sigma for nuisance in NUISANCES])

FAULTS: Final = (
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
)
FAULT_COUNT: Final = len(FAULTS)

# A block's row: end time, part of its time bridged, samples, measured supply pressure, part of its
# samples with one, then by chamber 1 and 2 the missing flow, the nuisances and the faults, then the
# faults' sizes, the doubts by chamber, and the least and greatest position.
_SUPPLY: Final = 3
_MISSING: Final = 5
_NUISANCE: Final = _MISSING + 2
_FAULT: Final = _NUISANCE + 2 * NUISANCE_COUNT
_SIZE: Final = _FAULT + 2 * FAULT_COUNT
_DOUBT: Final = _SIZE + FAULT_COUNT
_LEAST: Final = _DOUBT + 2
_WIDTH: Final = _LEAST + 2

_LEAST_DROP: Final = 1e5
"""Pa: keeps the slope of the orifice law finite where the pressure drop vanishes."""
_DROP_ERROR: Final = 2e5
"""Pa: how far a pressure drop may be off (priors of the pressures). Where it is no larger than
that, the orifice law is not linear in the error."""
_REACH: Final = 5
"""Ticks from one measured sample to the next that the filter bridges. In between, the flow is that
of the valve's model, whose spool is off by 2 um (`product_noise`): by 0.2 L/min, anew from gap to
gap. Over the n gaps of a block that is 0.2 L/min / n^0.5. It may make half the variance of the
noise that the test expects of a block (0.03 L/min, `leak_test.NOISE`), which allows 5.6 ms."""
_BRIDGED_PART: Final = 0.9
"""Part of a block's time that must have been bridged for it to count."""


@dataclass(frozen=True)
class AccountBlock:
    """The account of both chambers over half a second or more; flows in m^3/s, block averages.

    Attributes:
        start_s, end_s: time of the last sample before the block, and of its last.
        missing: float64 (2,), flow that entered by the model and is nowhere to be found.
        nuisances: float64 (2, 15), missing flow of a rig that has one standard deviation of each of
            `NUISANCES` more than the model.
        faults: float64 (2, 5), missing flow per unit coefficient of each of `FAULTS` (SI; for
            supply leakage per Pa of lost supply pressure).
        sizes: float64 (5,), mean absolute flow per unit coefficient.
        complete: whether measured samples bridged enough of the block, and all sums are finite.
        doubts: float64 (2,), what nuisances may add to the missing flow beyond these linear terms.
        position_range: least and greatest position of the ram, m.
        supply_pressure: mean measured supply pressure, Pa; NaN if it was not measured.
    """

    start_s: float
    end_s: float
    missing: Array
    nuisances: Array
    faults: Array
    sizes: Array
    complete: bool
    doubts: Array = field(default_factory=lambda: np.zeros(2))
    position_range: tuple[float, float] = (0.0, 0.0)
    supply_pressure: float = float("nan")


@njit(cache=True, error_model="numpy")
def _doubt(conductance, drop):
    """Return what an error of the drop (Pa) adds to a flow beyond its linear term, m^3/s.

    A root differs from its tangent by drop^0.5 (error / drop)^2 / 8, and by error^0.5 at no drop.
    """
    ratio = abs(drop) / _DROP_ERROR
    return abs(conductance) * sqrt(_DROP_ERROR) / (1.0 + 8.0 * ratio * sqrt(ratio))


@njit(cache=True, error_model="numpy")
def _tick(spool, spool_rate, null_bias, null_spread, p1, p2, par, row):
    """Add one sample's flows and signatures to the sums in `row`.

    A signature is the missing flow of a rig with one unit more of a weakness than the model. The
    null bias only tells which edges are open; its flow is left to the nuisance, so that a leak
    cannot hide in it. Where the bias is not known well enough to tell the edges, their difference
    is in doubt.
    """
    supply, back = par.supply_pressure, par.return_pressure
    conductance = valve_conductance(par)
    opening = spool + par.spool_null_bias
    extending = spool + null_bias >= 0.0
    drop_1 = supply - p1 if extending else p1 - back
    drop_2 = p2 - back if extending else supply - p2
    # Flow per opening into chamber 1 and out of chamber 2.
    g1, g2 = conductance * signed_root(drop_1), conductance * signed_root(drop_2)
    q1, q2 = g1 * opening, g2 * opening
    slope_1 = 0.5 * q1 / max(drop_1, _LEAST_DROP)
    slope_2 = 0.5 * q2 / max(drop_2, _LEAST_DROP)
    leak_1, leak_2, leak_12 = leak_flows(p1, p2, back, par, NO_FAULT)
    row[_MISSING] += q1 - leak_1 - leak_12
    row[_MISSING + 1] += -q2 - leak_2 + leak_12

    n = _NUISANCE
    side = 1.0 if extending else -1.0
    row[n] -= g1
    row[n + 1] += g2
    row[n + 2] += g1 * side
    row[n + 3] -= g2 * side
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
    row[n + 26] -= g1 * spool_rate
    row[n + 27] += g2 * spool_rate

    f = _FAULT
    e1, e2, e12 = signed_root(p1 - back), signed_root(p2 - back), signed_root(p1 - p2)
    row[f] += e1
    row[f + 3] += e2
    row[f + 4] += e12
    row[f + 5] -= e12
    if extending:
        row[f + 6] += slope_1
        row[f + 9] -= slope_2 * q2 * q2
    else:
        row[f + 7] -= slope_2
        row[f + 8] += slope_1 * q1 * q1
    row[_DOUBT] += _doubt(conductance * opening, drop_1)
    row[_DOUBT + 1] += _doubt(conductance * opening, drop_2)
    untold = conductance * (null_spread - abs(spool + null_bias))
    if untold > 0.0:
        row[_DOUBT] += untold * abs(signed_root(supply - p1) - signed_root(p1 - back))
        row[_DOUBT + 1] += untold * abs(signed_root(supply - p2) - signed_root(p2 - back))
    row[_SIZE] += abs(e1)
    row[_SIZE + 1] += abs(e2)
    row[_SIZE + 2] += abs(e12)
    row[_SIZE + 3] += abs(slope_1) if extending else abs(slope_2)
    row[_SIZE + 4] += abs(slope_2 * q2 * q2) if extending else abs(slope_1 * q1 * q1)


@njit(cache=True, error_model="numpy")
def _accumulate(
    time_s, spool, p1, p2, position, fresh, supply, null_bias, null_spread, par, last, row, rows
):  # fmt: skip
    """Add samples to the running block `row`; move finished blocks to `rows`, return their number.

    `last` keeps (samples in the block, last spool, p1, p2, position, samples since a measured one)
    between calls; samples are -1 while no block can begin, for want of a sample before it or
    because a chamber is dry. Samples before the filter has started are NaN and passed over.
    """
    finished = 0
    for k in range(time_s.size):
        if np.isnan(position[k]):
            continue
        last[5] += 1.0
        bridged = 0.0
        if fresh[k] != 0.0:
            bridged = last[5] if last[5] <= _REACH else 1.0
            last[5] = 0.0
        dry = min(p1[k], p2[k]) < DRY
        if last[0] >= 0.0:
            if last[0] == 0.0:
                row[_LEAST] = row[_LEAST + 1] = last[4]
            v1, v2 = chamber_volumes(0.5 * (position[k] + last[4]), par)
            swept = par.piston_area * (position[k] - last[4]) / TICK
            squeezed_1 = v1 / par.bulk_modulus * (p1[k] - last[2]) / TICK
            squeezed_2 = v2 / par.bulk_modulus * (p2[k] - last[3]) / TICK
            rate = (spool[k] - last[1]) / TICK
            oil_1, oil_2 = 0.5 * (p1[k] + last[2]), 0.5 * (p2[k] + last[3])
            middle = 0.5 * (spool[k] + last[1])
            _tick(middle, rate, null_bias, null_spread, oil_1, oil_2, par, row)
            row[_MISSING] -= swept + squeezed_1
            row[_MISSING + 1] += swept - squeezed_2
            row[_FAULT - 2] -= squeezed_1
            row[_FAULT - 1] -= squeezed_2
            row[1] += bridged
            if not np.isnan(supply[k]):
                row[_SUPPLY] += supply[k]
                row[_SUPPLY + 1] += 1.0
            row[_LEAST] = min(row[_LEAST], position[k])
            row[_LEAST + 1] = max(row[_LEAST + 1], position[k])
            last[0] += 1.0
            if last[0] % BLOCK_TICKS == 0 and (not dry or last[0] == _LONGEST):
                for i in range(row.size):
                    rows[finished, i] = row[i] / last[0] if i < _LEAST else row[i]
                rows[finished, 0] = time_s[k]
                rows[finished, 1] = 0.0 if dry else rows[finished, 1]
                rows[finished, 2] = last[0]
                row[:] = 0.0
                last[0] = -1.0 if dry else 0.0
                finished += 1
        elif not dry:
            last[0] = 0.0
        last[1], last[2], last[3], last[4] = spool[k], p1[k], p2[k], position[k]
    return finished


class FlowAccount:
    """Accumulates samples into `AccountBlock`s, any number of samples at a time."""

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._last = np.array([-1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._row = np.zeros(_WIDTH)

    @property
    def samples_left(self) -> int:
        """Samples before which the present block cannot end."""
        samples = int(self._last[0])
        return BLOCK_TICKS - samples % BLOCK_TICKS if samples >= 0 else BLOCK_TICKS + 1

    def add(
        self,
        time_s: Array,
        spool: Array,
        p1: Array,
        p2: Array,
        position: Array,
        fresh: Array,
        *,
        supply: Array | None = None,
        null_bias: float = 0.0,
        null_spread: float = 0.0,
    ) -> list[AccountBlock]:
        """Add samples (float64 (n,) each, SI) and return the blocks they finish.

        Args:
            time_s: 1 kHz.
            spool: estimated; NaN before the filter has started, as the pressures and position.
            p1: estimated pressure of chamber 1.
            p2: estimated pressure of chamber 2.
            position: estimated.
            fresh: 1 where position and both pressures were measured, else 0; a block counts as
                complete when such samples, at most 5 ms apart, bridge nine tenths of it.
            supply: measured supply pressure; NaN or None where it was not.
            null_bias: of the rig's spool, m: tells which edges are open.
            null_spread: how far the null bias may be off, m.
        """
        if supply is None:
            supply = np.full(time_s.size, np.nan)
        rows = np.empty((time_s.size // BLOCK_TICKS + 1, _WIDTH))
        # Columns of a table would be another type, and another compilation.
        whole = np.ascontiguousarray
        count = _accumulate(
            whole(time_s), whole(spool), whole(p1), whole(p2), whole(position), whole(fresh),
            whole(supply), null_bias, null_spread, self._parameters, self._last, self._row, rows,
        )  # fmt: skip
        return [_block(row) for row in rows[:count]]


def _block(row: Array) -> AccountBlock:
    nuisances = row[_NUISANCE:_FAULT].reshape(NUISANCE_COUNT, 2).T
    measured = row[_SUPPLY + 1]
    return AccountBlock(
        start_s=float(row[0] - row[2] * TICK),
        end_s=float(row[0]),
        missing=row[_MISSING:_NUISANCE].copy(),
        nuisances=nuisances * _SIGMA,
        faults=row[_FAULT:_SIZE].reshape(FAULT_COUNT, 2).T.copy(),
        sizes=row[_SIZE:_DOUBT].copy(),
        complete=bool(row[1] >= _BRIDGED_PART and np.isfinite(row).all()),
        doubts=row[_DOUBT:_LEAST].copy(),
        position_range=(float(row[_LEAST]), float(row[_LEAST + 1])),
        supply_pressure=float(row[_SUPPLY] / measured) if measured else float("nan"),
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
