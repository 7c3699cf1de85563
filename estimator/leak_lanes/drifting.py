"""Scores of a drift of the encoder and of its rivals in compiled code, as `DriftTest` makes them.

The products of the blocks are summed from the newest one back to each onset, in one pass over the
rows. The scores are those of `scoring`, with one cause more than a search for faults has.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import FAULT_COUNT, NOISE_WEIGHT, NUISANCE_COUNT, Scores
from rig.jit import njit

from .scoring import fit_nuisances, score

Array = NDArray[np.float64]

_FIRST: Final = 1 + NUISANCE_COUNT
"""Index of the first cause in a row, after the missing flow and the nuisances."""
_DRIFT: Final = FAULT_COUNT + 1
_SHAPES: Final = FAULT_COUNT + 3
"""Number of causes and of the small shift that each is fitted with, which comes last."""
_PER_SECOND: Final = _SHAPES
_ROUNDS: Final = 3


@njit(cache=True, error_model="numpy", nogil=True)
def _drift_sums(rows, starts, before, blocks, group, witness_groups):
    """Return the products of the nuisances, and those of the causes from each onset on.

    Args:
        rows: rows of the blocks that are kept, as of `DriftTest`, (kept, 2, width); block i is at
            i modulo their number.
        starts: start of each of these blocks, s, (kept,).
        before: products of the columns over all blocks that are no longer kept, (width, width).
        blocks: number of blocks so far.
        group: blocks from one onset to the next.
        witness_groups: fewest groups of blocks since an onset.

    Returns:
        Products of the nuisances with each other and with the missing flow, and that of the latter
        with itself; then those of the causes, as `scoring.score` takes them: with the nuisances,
        with each other, and with the missing flow.
    """
    kept, width = rows.shape[0], rows.shape[2]
    ff, fy, yy = np.zeros((_FIRST - 1, _FIRST - 1)), np.zeros(_FIRST - 1), before[0, 0]
    for a in range(1, _FIRST):
        fy[a - 1] = before[a, 0]
        for b in range(1, _FIRST):
            ff[a - 1, b - 1] = before[a, b]
    for j in range(min(blocks, kept)):
        for c in range(2):
            row = rows[j, c]
            yy += row[0] * row[0]
            for a in range(1, _FIRST):
                part = row[a]
                fy[a - 1] += part * row[0]
                for b in range(1, _FIRST):
                    ff[a - 1, b - 1] += part * row[b]
    groups = min(blocks, kept) // group
    # A drift from the first block on cannot be told from the nuisances.
    first = 0 if blocks > kept else 1
    onsets = groups - witness_groups + 1 - first
    squares = np.empty((onsets, _SHAPES, _SHAPES))
    crossed = np.empty((_FIRST - 1, _SHAPES, onsets))
    products = np.empty((onsets, _SHAPES))
    since, line = np.zeros((_SHAPES + 1, width)), np.empty(width)
    for g in range(groups - 1, first - 1, -1):
        begin = blocks - (groups - g) * group
        for j in range(begin, begin + group):
            for c in range(2):
                row = rows[j % kept, c]
                for i in range(_SHAPES + 1):
                    part = row[_FIRST + i]
                    for a in range(width):
                        since[i, a] += part * row[a]
        onset = g - first
        if onset >= onsets:
            continue
        began = starts[begin % kept]
        for i in range(_SHAPES):
            for a in range(width):
                line[a] = since[i, a]
                if i == _DRIFT:
                    line[a] -= began * since[_PER_SECOND, a]
            line[_FIRST + _DRIFT] -= began * line[_FIRST + _PER_SECOND]
            products[onset, i] = line[0]
            for a in range(1, _FIRST):
                crossed[a - 1, i, onset] = line[a]
            for k in range(_SHAPES):
                squares[onset, i, k] = line[_FIRST + k]
    return ff, fy, yy, crossed, squares, products


def drift_scores(
    rows: Array,
    starts: Array,
    before: Array,
    blocks: int,
    settings: tuple[int, int, float, float],
) -> tuple[Scores, Array, float]:
    """Return the scores of all causes from all onsets on, their gains, and the degrees of freedom.

    The gains are in twice the log likelihood, (onsets, causes).

    Args:
        rows: rows of the blocks that are kept, as of `DriftTest`, (kept, 2, width); block i is at
            i modulo their number.
        starts: start of each of these blocks, s, (kept,).
        before: products of the columns over all blocks that are no longer kept, (width, width).
        blocks: number of blocks so far.
        settings: `DriftTest.settings`.
    """
    group, witness_groups, least, settled = settings
    ff, fy, yy, crossed, squares, products = _drift_sums(
        rows, starts, before, blocks, group, witness_groups
    )
    variance, used = fit_nuisances(ff, fy, yy, 2.0 * blocks, least)
    left_free = NOISE_WEIGHT + 2.0 * blocks - used - 1.0
    scores = np.empty((4, len(squares), _SHAPES - 1))
    for _ in range(_ROUNDS):
        score(crossed, squares, products, ff, fy, yy, left_free, variance, least, scores)
        left = float(scores[3].min())
        if left > settled * variance:
            break
        variance = left
    freedom = max(left_free, NOISE_WEIGHT)
    gain = freedom * np.log1p(scores[2] / (freedom * scores[3]))
    return Scores(*scores), gain, freedom
