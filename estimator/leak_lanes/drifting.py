"""Scores of a drift of the encoder and of its rivals in compiled code, as `DriftTest` makes them.

The products of the blocks are summed from the newest one back to each onset, in one pass over the
rows. The scores are those of `scoring`, with one cause more than a search for faults has.
"""

from math import log1p
from typing import Final

import numpy as np

from estimator.accounts import FAULT_COUNT, NOISE_WEIGHT, NUISANCE_COUNT
from rig.jit import njit

from .scoring import fit_nuisances, score

_FIRST: Final = 1 + NUISANCE_COUNT
"""Index of the first cause in a row, after the missing flow and the nuisances."""
_DRIFT: Final = FAULT_COUNT + 1
_SHAPES: Final = FAULT_COUNT + 3
"""Number of causes and of the small shift that each is fitted with, which comes last."""
_PER_SECOND: Final = _SHAPES
_ROUNDS: Final = 3


@njit(cache=True, error_model="numpy", nogil=True)
def drift_scores(rows, starts, before, blocks, group, witness_groups, least, settled):
    """Return the scores of all causes from all onsets on, their gains, and the degrees of freedom.

    Args:
        rows: rows of the blocks that are kept, as of `DriftTest`, (kept, 2, width); block i is at
            i modulo their number.
        starts: start of each of these blocks, s, (kept,).
        before: products of the columns over all blocks that are no longer kept, (width, width).
        blocks: number of blocks so far.
        group: blocks from one onset to the next.
        witness_groups: fewest groups of blocks since an onset.
        least: lower bound of the noise variance.
        settled: if a cause leaves less than this part of the noise variance, that is estimated
            anew.

    Returns:
        The fields of `Scores`, (4, onsets, causes), the gains in twice the log likelihood,
        (onsets, causes), and the degrees of freedom.
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
    variance, used = fit_nuisances(ff, fy, yy, 2.0 * blocks, least)
    left_free = NOISE_WEIGHT + 2.0 * blocks - used - 1.0
    scores = np.empty((4, onsets, _SHAPES - 1))
    for _ in range(_ROUNDS):
        score(crossed, squares, products, ff, fy, yy, left_free, variance, least, scores)
        left = scores[3].min()
        if left > settled * variance:
            break
        variance = left
    freedom = max(left_free, NOISE_WEIGHT)
    gain = np.empty((onsets, _SHAPES - 1))
    for j in range(onsets):
        for i in range(_SHAPES - 1):
            gain[j, i] = freedom * log1p(scores[2, j, i] / (freedom * scores[3, j, i]))
    return scores, gain, freedom
