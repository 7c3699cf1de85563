"""The oil account of each chamber: the flow that should have entered, less what is accounted for.

Integrated over a block of half a second (longer while a chamber is dry), eq. 2.3 balances without
friction, load or acceleration:

    valve flow in = swept volume + compression + leaks.

Flow that is missing in this balance is a leak or an error of the model. The account of a block is
one row for each chamber. It holds the missing flow, and the missing flow that each fault and each
known weakness of the model would make. The noise of an account is small: one encoder count in half
a second is 0.002 L/min. This is what makes small leaks visible
(docs/decisions/0006-oil-account.md).
"""

from dataclasses import dataclass, field
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import DRY
from rig.jit import njit
from rig.plant import DATA_SHEET, TICK, Parameters

from .nuisances import NUISANCE_COUNT, NUISANCES
from .row import (
    BRIDGED,
    DEPARTURE,
    DOUBT,
    END,
    FAULT,
    FAULT_COUNT,
    LEAST,
    MISSING,
    NUISANCE,
    SAMPLES,
    SIZE,
    SUPPLY,
    WIDTH,
    add_motion,
    add_sample,
    add_supply,
    add_terms,
)

Array = NDArray[np.float64]

BLOCK_TICKS: Final = 500
BLOCK_S: Final = BLOCK_TICKS * TICK

_SIGMA: Final = np.array([nuisance.sigma for nuisance in NUISANCES])
_LONGEST: Final = 16 * BLOCK_TICKS
"""Samples (8 s) after which a block is given up because a chamber is still dry.

Cavities open and close again. A block therefore ends only when neither chamber is dry; until then
it grows by half a second at a time."""


SPOOL_SHARE: Final = 0.01
"""Weight of the latest sample in the running averages of the spool and of its noise, which thus
cover some 0.1 s."""
SPOOL_NOISE: Final = 0.43 * DATA_SHEET.spool_noise
"""Standard deviation in m of the product filter's estimate of a spool at rest, by the transducer's
noise. If the estimate varies by more, the spool moves."""

FROZEN_SAMPLES: Final = 40
"""A pressure with this many equal readings in a row counts as not measured, for noise of 30 kPa
would not allow that. The detector only leaves such samples out, on any rig; the loop, which trips
on them, derives its count from the chance of a false trip
(`rig.loop.interlocks.check_tolerances.frozen_samples`)."""

_REACH: Final = 5
"""Greatest number of ticks from one measured sample to the next that count as bridged.

In between, the flow is that of the valve's model, whose spool is off by 2 um (`product_noise`).
This makes 0.2 L/min, independent from gap to gap. Over the n gaps of a block it is
0.2 L/min / n^0.5, or 0.02 L/min with gaps of 5 ms. That is twice the noise that the test expects of
a block (`noise.MODEL_NOISE`); the test estimates the noise and allows for it."""
_BRIDGED_PART: Final = 0.9
"""Least part of a block's time that must be bridged for the block to be complete."""
_READ_PART: Final = _BRIDGED_PART / _REACH
"""Least part of a block's samples with a spool reading from which their mean departure is taken: as
many as a block has that is just complete."""


@dataclass(frozen=True, eq=False)
class AccountBlock:
    """The account of both chambers over half a second or more; flows are block averages in m^3/s.

    Attributes:
        start_s, end_s: time of the last sample before the block, and time of its last sample, s.
        missing: float64 (2,), flow that entered the chamber according to the model and that
            neither moved the ram nor was compressed.
        nuisances: float64 (2, n), missing flow of a rig that exceeds the model by one standard
            deviation of each of `NUISANCES`.
        faults: float64 (2, 5), missing flow per unit coefficient of each of `FAULTS` (SI; for
            supply leakage per Pa of lost supply pressure).
        sizes: float64 (5,), mean absolute flow of each fault per unit coefficient.
        complete: whether measured samples bridged enough of the block and all sums are finite;
            only complete blocks are tested.
        doubts: float64 (2,), flow that nuisances may add to the missing flow beyond their linear
            terms.
        position_range: least and greatest position of the ram, m.
        supply_pressure: mean measured supply pressure, Pa; NaN if it was not measured.
        supply_flow: mean flow that the valve drew from the supply at the same samples, m^3/s, and
            the mean of its signed square, m^6/s^2; NaN if the supply pressure was not measured.
        spool_departure: mean of the spool's readings less the filter's estimates of the same
            samples, m; NaN without a spool transducer, or where too few readings came.
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
    supply_flow: tuple[float, float] = (float("nan"), float("nan"))
    spool_departure: float = float("nan")


@njit(cache=True, error_model="numpy")
def _accumulate(samples, null, par, last, row, rows):
    """Add samples to the running block `row`; move finished blocks to `rows`, return their number.

    Samples before the filter has started (NaN) are passed over.

    Args:
        samples: (7, n) or (8, n), as in `FlowAccount.add`.
        null: null bias of the spool and its standard deviation, m.
        par: the `Parameters` that are assumed.
        last: (8,), memory between calls, updated. It holds the number of samples in the block (-1
            while no block can begin, because there is no sample before it or a chamber is dry),
            the last spool, p1, p2 and position, the number of samples since a measured one, and
            running averages of the spool and of its squared deviation.
        row: (WIDTH,) sums of the running block, updated.
        rows: (blocks, WIDTH), filled with the finished blocks.
    """
    finished = 0
    for k in range(samples.shape[1]):
        spool, p1, p2, position = samples[1, k], samples[2, k], samples[3, k], samples[4, k]
        if np.isnan(position):
            continue
        last[5] += 1.0
        bridged = 0.0
        if samples[5, k] != 0.0:
            bridged = last[5] if last[5] <= _REACH else 1.0
            last[5] = 0.0
        dry = min(p1, p2) < DRY
        difference = spool - last[6]
        last[6] += SPOOL_SHARE * difference
        last[7] += SPOOL_SHARE * (difference * difference - last[7])
        if last[0] >= 0.0:
            if last[0] == 0.0:
                row[LEAST] = row[LEAST + 1] = last[4]
            rate = (spool - last[1]) / TICK
            oil_1, oil_2 = 0.5 * (p1 + last[2]), 0.5 * (p2 + last[3])
            shown = 0.5 * (spool + last[1])
            deviation = min(sqrt(last[7]), SPOOL_NOISE)
            add_sample(shown, rate, last[6], deviation, null, oil_1, oil_2, par, row)
            moved = (position - last[4]) / TICK
            rise_1, rise_2 = (p1 - last[2]) / TICK, (p2 - last[3]) / TICK
            middle = 0.5 * (position + last[4])
            add_motion(middle, moved, oil_1, oil_2, rise_1, rise_2, par, row)
            if par.term_1_kind != 0.0:
                add_terms(shown, shown + null[0], middle, moved, oil_1, oil_2, par, row)
            row[BRIDGED] += bridged
            supply = samples[6, k]
            if not np.isnan(supply):
                add_supply(shown + null[0], oil_1, oil_2, supply, par, row)
            if samples.shape[0] > 7 and not np.isnan(samples[7, k]):
                row[DEPARTURE] += samples[7, k]
                row[DEPARTURE + 1] += 1.0
            row[LEAST] = min(row[LEAST], position)
            row[LEAST + 1] = max(row[LEAST + 1], position)
            last[0] += 1.0
            if last[0] % BLOCK_TICKS == 0 and (not dry or last[0] == _LONGEST):
                for i in range(row.size):
                    rows[finished, i] = row[i] / last[0] if i < LEAST else row[i]
                rows[finished, END] = samples[0, k]
                rows[finished, BRIDGED] = 0.0 if dry else rows[finished, BRIDGED]
                rows[finished, SAMPLES] = last[0]
                row[:] = 0.0
                last[0] = -1.0 if dry else 0.0
                finished += 1
        elif not dry:
            last[0] = 0.0
        last[1], last[2], last[3], last[4] = spool, p1, p2, position
    return finished


class FlowAccount:
    """Collects samples into `AccountBlock`s; any number of samples may be added at a time.

    Args:
        parameters: the parameters of the rig that are assumed.
    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self._last = np.array([-1.0, *[0.0] * 7])
        self._row = np.zeros(WIDTH)

    @property
    def memory(self) -> Array:
        """Memory between samples, (8,), as `_accumulate` describes it; it may be written to."""
        return self._last

    @property
    def samples_left(self) -> int:
        """Return the least number of further samples with which a block can be finished."""
        samples = int(self._last[0])
        return BLOCK_TICKS - samples % BLOCK_TICKS if samples >= 0 else BLOCK_TICKS + 1

    def add(self, samples: Array, null: tuple[float, float] = (0.0, 0.0)) -> list[AccountBlock]:
        """Add samples and return the blocks they finish.

        The list is empty if they finish no block, and it has incomplete blocks too
        (`AccountBlock.complete`). Samples without an estimated position (NaN) are passed over.

        Args:
            samples: float64 (7, n) or (8, n), C-contiguous, SI, at 1 kHz. The rows are the time of
                each sample; the estimated spool position, pressures of chambers 1 and 2 and
                position of the ram, which are NaN before the filter has started; 1 where position
                and both pressures were measured, else 0; the measured supply pressure, NaN where it
                is missing; and, if there is an eighth row, the spool's reading less its estimate,
                NaN where it was not read. A block is complete if samples of which all but the last
                two rows is measured, at most 5 ms apart, bridge nine tenths of it.
            null: null bias of the rig's spool, which decides which edges are open, and its
                standard deviation, m.
        """
        rows = np.empty((samples.shape[1] // BLOCK_TICKS + 1, WIDTH))
        count = _accumulate(samples, null, self._parameters, self._last, self._row, rows)
        return [block_of(row) for row in rows[:count]]


def block_of(row: Array) -> AccountBlock:
    """Return the block whose sums, divided by its number of samples, are a row: (`row.WIDTH`,)."""
    nuisances = row[NUISANCE:FAULT].reshape(NUISANCE_COUNT, 2).T
    measured = row[SUPPLY + 1] or float("nan")
    read = row[DEPARTURE + 1] >= _READ_PART * row[SAMPLES]
    return AccountBlock(
        start_s=float(row[END] - row[SAMPLES] * TICK),
        end_s=float(row[END]),
        missing=row[MISSING:NUISANCE].copy(),
        nuisances=nuisances * _SIGMA,
        faults=row[FAULT:SIZE].reshape(FAULT_COUNT, 2).T.copy(),
        sizes=row[SIZE:DOUBT].copy(),
        complete=bool(row[BRIDGED] >= _BRIDGED_PART and np.isfinite(row).all()),
        doubts=row[DOUBT:LEAST].copy(),
        position_range=(float(row[LEAST]), float(row[LEAST + 1])),
        supply_pressure=float(row[SUPPLY] / measured),
        supply_flow=(float(row[SUPPLY + 2] / measured), float(row[SUPPLY + 3] / measured)),
        spool_departure=float(row[DEPARTURE] / row[DEPARTURE + 1]) if read else float("nan"),
    )


def reference_drop(parameters: Parameters, fault: str) -> float:
    """Return the pressure drop in Pa at which a leak's flow is quoted.

    It is half the difference of supply and return pressure. For `internal_leakage` it is the
    difference of the chamber pressures that a slow ram needs against its friction: 1.5 times the
    Coulomb friction (table 2.1) over the piston's area.
    """
    if fault == "internal_leakage":
        return 1.5 * parameters.coulomb / parameters.piston_area
    return 0.5 * (parameters.supply_pressure - parameters.return_pressure)


def reference_flow(parameters: Parameters, fault: str, coefficient: float) -> float:
    """Return the flow in m^3/s of a leak coefficient at its `reference_drop` (eq. 5.2).

    The coefficient is in m^3/(s Pa^0.5).
    """
    return coefficient * sqrt(reference_drop(parameters, fault))
