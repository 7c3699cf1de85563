"""The sequential test for an encoder that drifts, beside the causes that look like it.

An encoder whose reading runs away from the ram at a rate w shows in the accounts of both chambers
(`estimator.accounts.flow`) as oil that is missing in the one and too much in the other,

    m_1 = -A w - A w (t - t_0) (dp_1/dt) / beta,    m_2 = A w + A w (t - t_0) (dp_2/dt) / beta,

since an onset t_0. The first term is the travel that the ram did not make. The second one follows
from the position that is wrong by w (t - t_0): one chamber is taken for too large and the other one
for too small, so that too much or too little oil is compressed in them (eq. 2.3). At first the
drift looks like a leak past the piston, whose flow follows the sign of p_1 - p_2, or like a shift
of the spool's null, whose flow goes by the root of the valve's pressure drops. The more the
pressures change and the farther the reading has run away, the better the three are told apart.
docs/detection.md says how well, and docs/decisions/0035-encoder-drift.md why it is done so.
"""

from dataclasses import dataclass, replace
from math import hypot, inf, sqrt
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    BLOCK_S,
    NOISE_WEIGHT,
    NUISANCE_COUNT,
    NUISANCES,
    NULL_SHIFT,
    UNINFORMED,
    AccountBlock,
    FaultProducts,
    NuisanceBelief,
    Regression,
    Scores,
    lasting_noise,
    nuisance_index,
    student_quantile,
    whitening,
)
from rig.plant import FAULTS, LITRE_PER_MINUTE, Parameters, chamber_volumes

from .records import EncoderDrift

Array = NDArray[np.float64]

SHARE: Final = 0.1
"""Part of the stated rate of false alarms that this test may use.

The test for faults that stay comes to 0.8 of the stated rate at most, and that for leaks that come
and go has a tenth (`estimator.intermittent`); this one has what is left."""
DEAD_ZONE: Final = 0.03
"""Flow in L/min that a drift must exceed to be claimed; the nominal piston's is 0.8 mm/s.

By as much the spool's null of a healthy rig may wander in minutes: 0.3 um, which is `DRIFT` of its
tolerance (`estimator.accounts.nuisances`). It is not lowered with `model_error`, as a null wanders
however good the model is."""
RIVAL_GAIN: Final = 20.0
"""Gain in twice the log likelihood by which another cause is ruled out (odds e^10), as in
`estimator.leaks.leak_statistic`."""
NULL_SHIFT_NAME: Final = "null_shift"
MINIMUM_BLOCKS: Final = 16
"""Fewest blocks (8 s) with which a drift is claimed, as for any other fault."""
GROUP: Final = 4
"""Blocks (2 s) from one possible onset to the next, and from one look at the accounts to the next.
A drift of half a minute loses little by that, and a look costs a tenth of a millisecond."""
WITNESS_GROUPS: Final = 2
"""Fewest groups of blocks with a drift from which it is claimed (8 blocks, 4 s)."""
KEPT: Final = 240
"""Blocks (two minutes) with possible onsets; older ones count in sums only."""
LEAST_VARIANCE: Final = 1.0 / 16.0
"""Lower bound of the estimated noise variance, in units of the expected noise.

The noise of accounts on rigs that are the model is 0.0027 L/min where 0.0104 is expected with the
model's errors counted in (docs/detection.md), which is 1/15 in variance. What these errors make of
a drift is left to the dead zone."""
SETTLED_PART: Final = 0.8
"""If a cause leaves less than this part of the noise variance, the variance is estimated anew, as
in `estimator.leaks.fault_scores`."""
END_MARGIN: Final = 2e-3
"""Distance in m by which a reading must be beyond a stroke end to prove that the encoder is wrong.

The full supply pressure pushes the nominal ram 0.15 mm into its stop (8.7 kN at 6e7 N/m); the rest
is for a stroke that the model has wrong, and for the encoder's zero."""

_NULL_BIAS: Final = nuisance_index("spool_null_bias")
_BULK: Final = nuisance_index("bulk_modulus")
_N: Final = NUISANCE_COUNT
_FIRST: Final = 1 + _N
_FAULTS: Final = len(FAULTS)
_NULL: Final = _FAULTS
"""Index of a shift of the null among the causes, which are the faults, it, and the drift."""
_DRIFT: Final = _FAULTS + 1
_CAUSES: Final = (*FAULTS, NULL_SHIFT_NAME)
_SHIFT: Final = _FAULTS + 2
"""Index of the small shift of the null that each cause is fitted with, as in `LeakTest`."""
_PER_SECOND: Final = _FAULTS + 3
"""Index of what a drift adds for each second since its onset."""
_WIDTH: Final = _FIRST + _PER_SECOND + 1
"""Columns of a row: the missing flow, the nuisances, and the causes with the two of above."""


@dataclass(frozen=True)
class _Kept:
    """The rows of the blocks with possible onsets, oldest first, and the sums of all blocks.

    Attributes:
        rows: float64 (blocks, 2, width); the blocks are a multiple of `GROUP`.
        starts: start of each of them, s, float64 (blocks,).
        since: products of causes and null shift with all columns from each onset on, with a drift
            that began at that onset: float64 (onsets, causes + 1, width - 1).
        onsets: index among the rows of the first block of each onset, int64 (onsets,).
        total: products of the columns over all blocks, float64 (width, width).
    """

    rows: Array
    starts: Array
    since: Array
    onsets: NDArray[np.int64]
    total: Array


class DriftTest:
    """Tests the blocks added so far for a drift of the encoder, in bounded time and memory.

    Args:
        parameters: the parameters of the rig that are assumed.
        false_alarms_per_day: the stated rate, of which this test uses `SHARE`.
        expected: mean and covariance of the nuisances before any block.
        model_error: factor on what is allowed for errors of the model, as in `LeakTest`; the dead
            zone rises with it above 1, and does not fall below.

    Attributes:
        settings: constants of the test for compiled code: `GROUP`, `WITNESS_GROUPS`,
            `LEAST_VARIANCE` and `SETTLED_PART`.
    """

    settings: ClassVar[tuple[int, int, float, float]] = (
        GROUP, WITNESS_GROUPS, LEAST_VARIANCE, SETTLED_PART,
    )  # fmt: skip

    def __init__(
        self,
        parameters: Parameters,
        false_alarms_per_day: float,
        expected: NuisanceBelief = UNINFORMED,
        model_error: float = 1.0,
    ) -> None:
        self._parameters = parameters
        self._area = parameters.piston_area
        self._model_error = model_error
        self._expected = expected
        self._root = np.linalg.cholesky(expected.covariance)
        self._rate = SHARE * false_alarms_per_day * GROUP * BLOCK_S / 86400.0
        self._dead = max(model_error, 1.0) * DEAD_ZONE * LITRE_PER_MINUTE / self._area
        self._rows = np.zeros((KEPT, 2, _WIDTH))
        self._starts = np.zeros(KEPT)
        self._before = np.zeros((_WIDTH, _WIDTH))
        self._blocks = 0
        self._within = False
        self._beyond = False
        self._looked = 0
        self._found: EncoderDrift | None = None

    def see(self, position: Array) -> None:
        """Take the newest readings of the encoder, m; NaN where there is none.

        Once a reading that was within the stroke has passed its end by `END_MARGIN`, the encoder is
        wrong. The accounts, which need to know where the ram is, count no more from then on.
        """
        if self._beyond or not np.isfinite(position).any():
            return
        par = self._parameters
        least, greatest = float(np.nanmin(position)), float(np.nanmax(position))
        past = least < par.stroke_min - END_MARGIN or greatest > par.stroke_max + END_MARGIN
        if not past:
            self._within = True
        elif self._within:
            self.search()
            self._beyond = True

    def add(self, block: AccountBlock) -> None:
        """Add one block; an incomplete one, or one after a stroke end was passed, is ignored."""
        if not block.complete or self._beyond:
            return
        at = self._blocks % KEPT
        if self._blocks >= KEPT:
            self._before += self._rows[at].T @ self._rows[at]
        self._rows[at] = self._row(block)
        self._starts[at] = block.start_s
        self._blocks += 1

    def _row(self, block: AccountBlock) -> Array:
        """Return the row of a block, (2, width), in units of its expected noise."""
        white = whitening(block, self._model_error)
        nuisances = white @ block.nuisances
        null = block.nuisances[:, _NULL_BIAS]
        moved, per_second = self._moved(block)
        row = np.empty((2, _WIDTH))
        row[:, 0] = white @ block.missing - nuisances @ self._expected.mean
        row[:, 1:_FIRST] = nuisances @ self._root
        row[:, _FIRST:] = white @ np.column_stack(
            [block.faults, null, moved, self._model_error * null, per_second]
        )
        return row

    def _moved(self, block: AccountBlock) -> tuple[Array, Array]:
        """Return what a drift of 1 m/s that began at time 0 takes out of both chambers.

        The second value is what it takes for each second by which it began later. Both are (2,), in
        m^3/s and m^3/s^2.
        """
        # The oil that a chamber seems to take up per metre by which it is taken for too large.
        middle = 0.5 * (block.position_range[0] + block.position_range[1])
        one, two = (block.nuisances[:, _BULK] / NUISANCES[_BULK].sigma).tolist()
        # Handing all parameters to compiled code would take longer than the sums themselves.
        volume_1, volume_2 = chamber_volumes.py_func(middle, self._parameters)
        one, two = one * self._area / volume_1, -(two * self._area / volume_2)
        time_s = 0.5 * (block.start_s + block.end_s)
        moved = np.array([-self._area + time_s * one, self._area + time_s * two])
        return moved, np.array([one, two])

    def search(self) -> EncoderDrift | None:
        """Return the drift if it stands out and may be the cause, else None.

        It is looked for in every `GROUP` blocks; in between the last result is returned.
        """
        if self._beyond:
            return self._found and replace(self._found, gain=inf, could_also_be=())
        looks = self._blocks // GROUP
        if looks != self._looked:
            self._looked = looks
            self._found = self._searched() if self._blocks >= MINIMUM_BLOCKS else None
        return self._found

    def _scores(self) -> tuple[Scores, Array, float]:
        """Return the scores of all causes from all onsets on, as `_scored` does."""
        return _scored(self._kept(), 2 * self._blocks)

    def _searched(self) -> EncoderDrift | None:
        scores, gain, freedom = self._scores()
        onset = int(np.argmax(gain[:, _DRIFT]))
        coefficient = float(scores.coefficient[onset, _DRIFT])
        variance = float(scores.variance[onset, _DRIFT])
        error = sqrt(variance / max(float(scores.information[onset, _DRIFT]), 1e-300))
        limit = student_quantile(min(0.5 * self._rate / gain.shape[0], 0.25), freedom)
        if not abs(coefficient) > limit * error + self._dead:
            return None
        most = gain.max(axis=0)
        if most[_DRIFT] < most.max() - RIVAL_GAIN:
            return None
        rivals = [
            cause for cause in np.argsort(-most)
            if cause != _DRIFT and most[cause] >= most[_DRIFT] - RIVAL_GAIN
        ]  # fmt: skip
        # A fault with the wrong sign is none: the accounts are then wrong in some other way.
        best = gain.argmax(axis=0)
        if any(c < _FAULTS and scores.coefficient[best[c], c] <= 0.0 for c in rivals):
            return None
        kept = self._kept()
        rate, deviation, statistic = self._sized(kept, onset, variance)
        if not statistic > limit:
            return None
        return EncoderDrift(
            rate, deviation, float(kept.starts[kept.onsets[onset]]), statistic, limit,
            float(most[_DRIFT]), tuple(_CAUSES[cause] for cause in rivals),
        )  # fmt: skip

    def _kept(self) -> _Kept:
        count = min(self._blocks, KEPT) // GROUP * GROUP
        order = np.arange(self._blocks - count, self._blocks) % KEPT
        rows = self._rows[order]
        groups = rows.reshape(-1, 2 * GROUP, _WIDTH)
        products = groups[:, :, _FIRST:].transpose(0, 2, 1) @ groups
        # A drift from the first block on cannot be told from the nuisances.
        first = 0 if self._blocks > KEPT else 1
        onsets = np.arange(first, len(groups) - WITNESS_GROUPS + 1)
        since = np.cumsum(products[::-1], axis=0)[::-1][onsets]
        starts = self._starts[order]
        began = starts[onsets * GROUP, None]
        since[:, _DRIFT, :] -= began * since[:, _PER_SECOND, :]
        since[:, :, _FIRST + _DRIFT] -= began * since[:, :, _FIRST + _PER_SECOND]
        every = self._rows[: min(self._blocks, KEPT)].reshape(-1, _WIDTH)
        total = self._before + every.T @ every
        return _Kept(rows, starts, since[:, :-1, :-1], onsets * GROUP, total)

    def _sized(self, kept: _Kept, onset: int, variance: float) -> tuple[float, float, float]:
        """Return rate and standard error of a drift (m/s), and its statistic.

        The standard error covers noise that differs or lasts from block to block, and the tolerance
        of the oil's bulk modulus, as the oil that a wrong position seems to compress tells much of
        the rate. The statistic is that without the block that supports the drift most.

        Args:
            kept: the blocks.
            onset: index of the onset.
            variance: noise variance, in units of the expected noise.
        """
        since = kept.since[onset, [_DRIFT, _SHIFT]]
        normal = np.empty((_N + 2, _N + 2))
        normal[:_N, :_N] = kept.total[1:_FIRST, 1:_FIRST] + variance * np.eye(_N)
        normal[_N:, :_N] = since[:, 1:_FIRST]
        normal[:_N, _N:] = normal[_N:, :_N].T
        normal[_N:, _N:] = since[:, [_FIRST + _DRIFT, _FIRST + _SHIFT]]
        normal[-1, -1] += variance / NULL_SHIFT**2
        right = np.append(kept.total[1:_FIRST, 0], since[:, 0])
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(normal), 1e-300))
        inverse = scale[:, None] * np.linalg.inv(scale[:, None] * normal * scale) * scale
        fitted = inverse @ right
        rows = self._columns(kept, onset)
        left = kept.rows[:, :, 0] - rows @ fitted
        pull = rows @ inverse[_N]
        influence = (pull * left).sum(axis=1)
        leverage = (pull * pull).sum(axis=1) / inverse[_N, _N]
        without = fitted[_N] - influence / np.maximum(1.0 - leverage, 1e-3)
        error = max(variance * inverse[_N, _N], float((influence**2).sum()))
        deviation = sqrt(error * lasting_noise(left, self._model_error))
        statistic = (float(np.abs(without).min()) - self._dead) / deviation
        rate = float(fitted[_N])
        return rate, hypot(deviation, NUISANCES[_BULK].sigma * rate), statistic

    @staticmethod
    def _columns(kept: _Kept, onset: int) -> Array:
        """Return nuisances, drift and null shift of each kept block: (blocks, 2, n + 2)."""
        first = kept.onsets[onset]
        rows = kept.rows
        causes = rows[:, :, _FIRST:]
        drift = causes[:, :, _DRIFT] - kept.starts[first] * causes[:, :, _PER_SECOND]
        shapes = np.stack([drift, causes[:, :, _SHIFT]], axis=2)
        shapes[:first] = 0.0
        return np.concatenate([rows[:, :, 1:_FIRST], shapes], axis=2)


def _scored(kept: _Kept, count: int) -> tuple[Scores, Array, float]:
    """Return the scores of all causes from all onsets on, their gains, and the degrees of freedom.

    The gains are in twice the log likelihood, float64 (onsets, causes).

    Args:
        kept: the blocks.
        count: number of values of missing flow, two for each block.
    """
    total, since = kept.total, kept.since
    regression = Regression(
        total[1:_FIRST, 1:_FIRST], total[1:_FIRST, 0], float(total[0, 0]), count, LEAST_VARIANCE
    )
    # The scores need neither the sizes of the faults nor the numbers of blocks.
    none = np.empty(0)
    crossed = np.ascontiguousarray(since[:, :, 1:_FIRST])
    products = FaultProducts(since[:, :, _FIRST:], crossed, since[:, :, 0], none, none)
    variance = regression.variance
    for _ in range(3):
        scores = regression.score(crossed, products, variance)
        left = float(scores.variance.min())
        if left > SETTLED_PART * variance:
            break
        variance = left
    freedom = max(regression.freedom, NOISE_WEIGHT)
    gain = freedom * np.log1p(scores.explained / (freedom * scores.variance))
    return scores, gain, freedom
