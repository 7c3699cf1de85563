"""The oil accounts of several rigs at once, one in each lane (`rig.lanes`).

Rigs are independent, but most of them are in the same state: all is measured, no chamber is dry,
and a block ends with the half second. The samples of such a lane are added for all lanes in common.
Any other lane adds the samples of this half second alone, by the code of `flow.FlowAccount`, and
joins the others again with a later half second. Both ways have the same results, up to round-off of
e^x.
"""

from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import DRY
from rig.jit import njit
from rig.lanes import LANES, align_stack, aligned, anywhere, in_lanes, load, select, store
from rig.plant import TICK, Parameters

from .flow import (
    BLOCK_TICKS,
    FROZEN_SAMPLES,
    SPOOL_NOISE,
    SPOOL_SHARE,
    AccountBlock,
    FlowAccount,
    block_of,
)
from .row import (
    BRIDGED,
    END,
    LEAST,
    MISSING,
    SAMPLES,
    SUPPLY,
    WIDTH,
    add_motion,
    add_sample,
    add_supply,
)

Array = NDArray[np.float64]

_OPEN: Final = 0.0
"""Number of samples in a lane's running block when the block has just begun."""
# Indices of the readings and of the filter's states that an account takes.
_POSITION: Final = 0
_PRESSURE_1: Final = 1
_PRESSURE_2: Final = 2
_SUPPLY_PRESSURE: Final = 4
_SPOOL_STATE: Final = 0
_PRESSURE_1_STATE: Final = 1
_PRESSURE_2_STATE: Final = 2
_POSITION_STATE: Final = 3


@njit(cache=True, error_model="numpy", nogil=True)
def _lane_block(readings, states, null, spread, par, last, row, joined):
    """Add the samples of half a second to the accounts of all lanes, as if all had the usual state.

    Args:
        readings: (ticks, 6, LANES), as in `LaneAccounts.add`. With one tick more than a block has,
            the first sample is the one before the first block.
        states: (ticks, 11, LANES), the filter's estimates after each sample.
        null: null bias of each spool, m, (1, LANES).
        spread: its standard deviation, m, (1, LANES).
        par: the `Parameters` that are assumed.
        last: (8, LANES), memory as of `flow._accumulate`; updated.
        row: (WIDTH, LANES), is filled with the means of the block.
        joined: (1, LANES), is filled with 1 for a lane that was in the usual state throughout, and
            with 0 for one whose memory and row are of no use.
    """
    align_stack()
    sums = in_lanes(row)
    for i in range(WIDTH):
        store(row, i, 0.0)
    ticks = readings.shape[0]
    first = ticks - BLOCK_TICKS
    counted, since = load(last, 0), load(last, 5)
    usual = (counted == _OPEN) & (since == 0.0)
    if first:
        usual = (counted == -1.0) & (since == 0.0)
    spool, p1, p2, position = load(last, 1), load(last, 2), load(last, 3), load(last, 4)
    steady, variance = load(last, 6), load(last, 7)
    nulls = load(null, 0), load(spread, 0)
    z, x = readings[0], states[0]
    same_1, same_2 = 0.0 * load(z, 0), 0.0 * load(z, 0)
    before_1, before_2 = load(z, _PRESSURE_1), load(z, _PRESSURE_2)
    supplied = load(z, _SUPPLY_PRESSURE) == load(z, _SUPPLY_PRESSURE)
    for k in range(ticks):
        z, x = readings[k], states[k]
        new_spool, new_position = load(x, _SPOOL_STATE), load(x, _POSITION_STATE)
        new_1, new_2 = load(x, _PRESSURE_1_STATE), load(x, _PRESSURE_2_STATE)
        reading_1, reading_2 = load(z, _PRESSURE_1), load(z, _PRESSURE_2)
        supply = load(z, _SUPPLY_PRESSURE)
        measured = load(z, _POSITION) + reading_1 + reading_2
        same_1 = select(reading_1 == before_1, same_1 + 1.0, 1.0)
        same_2 = select(reading_2 == before_2, same_2 + 1.0, 1.0)
        before_1, before_2 = reading_1, reading_2
        # What is not a number compares as false.
        usual = usual & (abs(measured) < np.inf) & (min(new_1, new_2) >= DRY)
        usual = usual & (new_position == new_position)
        usual = usual & (same_1 < FROZEN_SAMPLES) & (same_2 < FROZEN_SAMPLES)
        known = supply == supply
        usual = usual & ((known & supplied) | ~(known | supplied))
        difference = new_spool - steady
        steady += SPOOL_SHARE * difference
        variance += SPOOL_SHARE * (difference * difference - variance)
        if k >= first:
            if k == first:
                sums[LEAST] = position
                sums[LEAST + 1] = position
            rate = (new_spool - spool) / TICK
            oil_1, oil_2 = 0.5 * (new_1 + p1), 0.5 * (new_2 + p2)
            shown = 0.5 * (new_spool + spool)
            deviation = min(sqrt(variance), SPOOL_NOISE)
            add_sample(shown, rate, steady, deviation, nulls, oil_1, oil_2, par, sums)
            moved = (new_position - position) / TICK
            rise_1, rise_2 = (new_1 - p1) / TICK, (new_2 - p2) / TICK
            middle = 0.5 * (new_position + position)
            add_motion(middle, moved, oil_1, oil_2, rise_1, rise_2, par, sums)
            if anywhere(known):
                add_supply(shown + nulls[0], oil_1, oil_2, supply, par, sums)
            sums[LEAST] = min(sums[LEAST], new_position)
            sums[LEAST + 1] = max(sums[LEAST + 1], new_position)
        spool, p1, p2, position = new_spool, new_1, new_2, new_position
    unmeasured = ~supplied
    for i in range(WIDTH):
        if i < LEAST:
            mean = sums[i] / BLOCK_TICKS
            if SUPPLY <= i < MISSING:
                mean = select(unmeasured, 0.0, mean)
            sums[i] = mean
    sums[BRIDGED] = 1.0 + 0.0 * nulls[0]
    sums[SAMPLES] = BLOCK_TICKS + 0.0 * nulls[0]
    store(last, 0, _OPEN)
    store(last, 1, spool)
    store(last, 2, p1)
    store(last, 3, p2)
    store(last, 4, position)
    store(last, 5, 0.0)
    store(last, 6, steady)
    store(last, 7, variance)
    store(joined, 0, select(usual, 1.0, 0.0))


class LaneAccounts:
    """Draws up the accounts of `LANES` rigs in common, half a second at a time.

    Args:
        parameters: the parameters that all rigs are assumed to have.
        accounts: account of each lane, before its first sample; used where a lane is on its own.
    """

    def __init__(self, parameters: Parameters, accounts: Sequence[FlowAccount]) -> None:
        self._parameters, self._accounts = parameters, accounts
        self._last = aligned(np.transpose([account.memory for account in accounts]))
        self._row = aligned(np.zeros((WIDTH, LANES)))
        self._joined = aligned(np.zeros((1, LANES)))
        # Terms that were added to a model are computed for one rig at a time.
        self._alone = parameters.term_1_kind != 0.0

    def add(
        self, end_s: float, readings: Array, states: Array, nulls: Array
    ) -> list[AccountBlock | None]:
        """Add the samples of half a second; return the block that they finish, for each lane.

        None stands for a lane in another state than the usual one, whose samples were not added.
        They are to be added to its `FlowAccount`, after which `joined_by` is to be called.

        Args:
            end_s: time of the last sample, s.
            readings: float64 (ticks, 6, LANES), SI: position, pressures 1 and 2, spool, supply
                pressure and command of each sample. The first call has one tick more than a block.
            states: float64 (ticks, 11, LANES), the product filter's estimates after each sample.
            nulls: null bias of each spool and its standard deviation, m, (2, LANES).
        """
        if self._alone:
            return [None] * LANES
        before = self._last.copy()
        null, spread = aligned(nulls[:1]), aligned(nulls[1:])
        _lane_block(
            readings, states, null, spread, self._parameters, self._last, self._row, self._joined
        )
        self._row[END] = end_s
        rows = np.ascontiguousarray(self._row.T)
        blocks: list[AccountBlock | None] = []
        for lane, row in enumerate(rows):
            if self._joined[0, lane]:
                blocks.append(block_of(row))
                continue
            self._accounts[lane].memory[:] = before[:, lane]
            blocks.append(None)
        return blocks

    def joined_by(self, lane: int) -> None:
        """Take over the memory of a lane whose samples were added to its own account."""
        self._last[:, lane] = self._accounts[lane].memory
