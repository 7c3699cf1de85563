"""The sequential test for faults in the oil accounts: which fault, since when, how large, how sure.

At the end of every block the missing flows of all blocks so far are explained by

    missing = nuisances + coefficient x fault signature from an onset on + noise,

for each fault and each onset. Nuisances carry Gaussian priors, the coefficient is free and not
negative, the noise level is estimated with an inverse-gamma prior, so that a coefficient over its
standard error follows Student's t (Bayesian linear regression; generalised likelihood ratio over
the onset, Basseville and Nikiforov 1993, ch. 7). A model-error budget is added to the standard
error: no leak is claimed that a wandering spool null could feign.
"""

from dataclasses import dataclass
from math import exp, hypot, sqrt
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant.parameters import LITRE_PER_MINUTE

from .flow_account import BLOCK_S, FAULT_COUNT, NUISANCE_COUNT, AccountBlock

Array = NDArray[np.float64]

NOISE: Final = 0.03
"""Expected noise of one block's missing flow, L/min: twice the sensors' own (docs/detection.md)."""
NOISE_WEIGHT: Final = 8.0
"""How many blocks' worth of belief stands behind `NOISE`."""
FLOW_BUDGET: Final = (0.01, 0.01, 0.01, 0.03, 0.03)
"""Flow in L/min that the model may still be wrong by after the nuisances, by fault: 0.1 um of spool
null is 0.01 L/min; supply and return pressures wander by more than a leak would."""
RELATIVE_BUDGET: Final = 0.05
"""A second fault must exceed this part of the first one's flow: the leak law is not exact."""
MINIMUM_BLOCKS: Final = 16
"""Before that many, 8 s of motion, the nuisances are not told well enough to accuse anybody."""
WITNESSES: Final = 4
"""Blocks that must speak for a fault: from fewer, their spread cannot be told."""
_RIVAL_GAIN: Final = 20.0
"""Twice the log likelihood by which a rival cause must win to be preferred: odds of e^10."""
_LEAST_INFORMATION: Final = 1e-6
"""Below this part of its raw information a fault's signature is all nuisance, up to round-off."""
_LEAST_VARIANCE: Final = 0.05
"""The noise estimate, in units of NOISE^2, never falls below the sensors' own (0.007 L/min)."""
ONSETS: Final = 240
"""Onset candidates kept; when full, every second one of the older half goes."""


def student_quantile(probability: float, freedom: float) -> float:
    """Return the value that Student's t exceeds with a (small) probability, to 3 %.

    Wallace's transformation of the normal quantile (Wallace 1959, Ann. Math. Stat. 30).
    """
    z = -NormalDist().inv_cdf(probability)
    scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return sqrt(freedom * (exp(scaled * scaled / freedom) - 1.0))


@dataclass(frozen=True)
class NuisanceBelief:
    """Mean (15,) and covariance (15, 15) of the nuisances, each in units of its tolerance."""

    mean: Array
    covariance: Array


UNINFORMED: Final = NuisanceBelief(np.zeros(NUISANCE_COUNT), np.eye(NUISANCE_COUNT))
"""Nothing known but the tolerances."""


@dataclass(frozen=True)
class Finding:
    """One fault in the accounts.

    Attributes:
        fault: index into `FAULTS`.
        onset: index of the first block with the fault.
        onset_fraction: part of the block before that already had it, 0 to 1.
        coefficient, deviation: its coefficient and standard error, SI.
        statistic: coefficient over its standard error, budget included.
        likelihood: gain in twice the log likelihood, in units of the noise.
    """

    fault: int
    onset: int
    onset_fraction: float
    coefficient: float
    deviation: float
    statistic: float
    likelihood: float


class _Candidates(NamedTuple):
    """Every fault at every onset, float64 (onsets, faults) each.

    Coefficient (SI), its standard error with the budget, the budget alone, and the gain in twice
    the log likelihood.
    """

    coefficient: Array
    deviation: Array
    budget: Array
    gain: Array


@njit(cache=True, error_model="numpy")
def _scan(total_ff_inverse, solved, total, before, count, chosen, scores):
    """Fill `scores` (onsets, faults, 4): information, projection, sum of sizes, blocks.

    Arrays hold sums over blocks up to now (`total`) and before each onset (`before`), packed as
    [ll (5, 5), lf (5, 15), ly (5), size (5), blocks]; scaled by the noise.
    """
    n, m = FAULT_COUNT, NUISANCE_COUNT
    ll0, lf0, ly0, size0 = 0, n * n, n * n + n * m, n * n + n * m + n
    for j in range(count):
        for i in range(n):
            ll = total[ll0 + i * n + i] - before[j, ll0 + i * n + i]
            ly = total[ly0 + i] - before[j, ly0 + i]
            cc = 0.0
            cy = 0.0
            for a in range(m):
                ca = total[lf0 + i * m + a] - before[j, lf0 + i * m + a]
                cy += ca * solved[a]
                inner = 0.0
                for b in range(m):
                    cb = total[lf0 + i * m + b] - before[j, lf0 + i * m + b]
                    inner += total_ff_inverse[a, b] * cb
                cc += ca * inner
            information = ll - cc
            projection = ly - cy
            if chosen[0] >= 0:
                cross, own, own_projection = _against(
                    total_ff_inverse, solved, total, before, j, i, chosen
                )
                information -= cross * cross / own
                projection -= cross * own_projection / own
            scores[j, i, 0] = information if information > _LEAST_INFORMATION * ll else 0.0
            scores[j, i, 1] = projection
            scores[j, i, 2] = total[size0 + i] - before[j, size0 + i]
            scores[j, i, 3] = total[size0 + n] - before[j, size0 + n]


@njit(cache=True, error_model="numpy")
def _against(inverse, solved, total, before, j, i, chosen):
    """Return the cross and own information of a fault already found, and its projection."""
    n, m = FAULT_COUNT, NUISANCE_COUNT
    fault, onset = chosen[0], chosen[1]
    later = max(j, onset)
    lf0, ly0 = n * n, n * n + n * m
    cross = total[fault * n + i] - before[later, fault * n + i]
    own = total[fault * n + fault] - before[onset, fault * n + fault]
    own_projection = total[ly0 + fault] - before[onset, ly0 + fault]
    for a in range(m):
        ca = total[lf0 + fault * m + a] - before[onset, lf0 + fault * m + a]
        own_projection -= ca * solved[a]
        for b in range(m):
            cb = total[lf0 + i * m + b] - before[j, lf0 + i * m + b]
            co = total[lf0 + fault * m + b] - before[onset, lf0 + fault * m + b]
            cross -= ca * inverse[a, b] * cb
            own -= ca * inverse[a, b] * co
    return cross, own, own_projection


class LeakTest:
    """Tests the blocks it is given, one at a time, at a stated false-alarm rate.

    Args:
        false_alarms_per_day: alarms a healthy rig may raise in a day of continuous running.
        expected: what is believed of the nuisances before any block.
    """

    def __init__(self, false_alarms_per_day: float, expected: NuisanceBelief = UNINFORMED) -> None:
        if not 0.0 < false_alarms_per_day <= 1e4:
            raise ValueError(
                f"false_alarms_per_day: {false_alarms_per_day} is outside 0 to 10000 per day"
            )
        self.false_alarms_per_day = false_alarms_per_day
        self._expected = expected
        self._root = np.linalg.cholesky(expected.covariance)
        width = FAULT_COUNT * (FAULT_COUNT + NUISANCE_COUNT + 2) + 1
        self._ff = np.eye(NUISANCE_COUNT)
        self._fy = np.zeros(NUISANCE_COUNT)
        self._yy = 0.0
        self._total = np.zeros(width)
        self._before = np.zeros((ONSETS + 1, width))
        self._onset_blocks = np.zeros(ONSETS + 1, dtype=np.int64)
        self._onsets = 0
        self._blocks = 0
        self._alone: Array | None = None
        self._history: list[tuple[Array, Array, Array]] = []

    def nuisances(self) -> NuisanceBelief:
        """Return what the blocks so far say of the nuisances, if no fault is in them."""
        inverse = np.linalg.inv(self._ff)
        mean = np.einsum("nm,m->n", self._root, np.einsum("nm,m->n", inverse, self._fy))
        covariance = np.einsum("an,nm,bm->ab", self._root, inverse, self._root)
        return NuisanceBelief(self._expected.mean + mean, covariance)

    @property
    def blocks(self) -> int:
        """How many complete blocks were tested."""
        return self._blocks

    def threshold(self, freedom: float) -> float:
        """Return the value of the statistic that a healthy rig exceeds at the stated rate.

        The chance of a false alarm in one block is shared out over all faults and onsets looked at
        (Bonferroni's bound, so the true rate is lower), and turned into a quantile of Student's t.
        """
        per_block = self.false_alarms_per_day * BLOCK_S / 86400.0
        looks = FAULT_COUNT * max(self._onsets, 1)
        return student_quantile(min(per_block / looks, 0.25), freedom)

    def add(self, block: AccountBlock) -> None:
        """Take one more block; incomplete blocks only pass the time."""
        if not block.complete:
            return
        if self._onsets == ONSETS:
            self._thin()
        self._before[self._onsets] = self._total
        self._onset_blocks[self._onsets] = self._blocks
        self._onsets += 1
        y = block.missing / (LITRE_PER_MINUTE * NOISE)
        f = block.nuisances / (LITRE_PER_MINUTE * NOISE)
        y = y - np.einsum("cn,n->c", f, self._expected.mean)
        f = np.einsum("cn,nm->cm", f, self._root)
        faults = block.faults / (LITRE_PER_MINUTE * NOISE)
        self._ff += f.T @ f
        self._fy += f.T @ y
        self._yy += float(y @ y)
        self._total += np.concatenate(
            [(faults.T @ faults).ravel(), (faults.T @ f).ravel(), faults.T @ y,
             block.sizes / LITRE_PER_MINUTE, [1.0]]
        )  # fmt: skip
        self._history.append((y, f, faults))
        self._alone = None
        self._blocks += 1

    def _thin(self) -> None:
        half = ONSETS // 2
        kept = np.concatenate([np.arange(0, half, 2), np.arange(half, ONSETS)])
        self._before[: kept.size] = self._before[kept]
        self._onset_blocks[: kept.size] = self._onset_blocks[kept]
        self._onsets = kept.size

    def search(self) -> list[Finding]:
        """Return the faults found in all blocks so far: none, one, or two at once."""
        if self._blocks < MINIMUM_BLOCKS:
            return []
        first = self._best(np.array([-1, 0]), 0.0)
        if first is None:
            return self._pair()
        chosen = np.array([first.fault, self._candidate(first.onset)])
        second = self._best(chosen, first.coefficient * self._mean_size(first))
        return [first] if second is None else [first, second]

    def _pair(self) -> list[Finding]:
        """Return two faults neither of which stands out while the other passes for noise."""
        gain = self._candidates(np.array([-1, 0]), 0.0).gain
        j, i = np.unravel_index(int(np.argmax(gain)), gain.shape)
        second = self._best(np.array([i, j]), 0.0)
        if second is None:
            return []
        first = self._best(np.array([second.fault, self._candidate(second.onset)]), 0.0)
        return [] if first is None else [first, second]

    def smallest(self, part: float = 0.5) -> Array:
        """Return the smallest coefficient of each fault (5,), SI, that would have been found.

        `part` of the blocks had passed when the fault began (0: it was there from the first).
        """
        scores = self._scores(np.array([-1, 0]))
        j = int(part * self._onsets)
        freedom = NOISE_WEIGHT + 2 * self._blocks
        variance = max((NOISE_WEIGHT + self._misfit()) / freedom, _LEAST_VARIANCE)
        size = scores[j, :, 2] / scores[j, :, 3]
        visible = (scores[j, :, 0] > 0.0) & (size > 0.0)
        error = variance / np.where(visible, scores[j, :, 0], 1.0)
        budget = np.array(FLOW_BUDGET) / np.where(visible, size, 1.0)
        return np.where(visible, self.threshold(freedom) * np.sqrt(error + budget**2), np.inf)

    def _candidate(self, onset_block: int) -> int:
        return int(np.searchsorted(self._onset_blocks[: self._onsets], onset_block))

    def _mean_size(self, finding: Finding) -> float:
        """Mean absolute flow per unit coefficient since the onset, L/min."""
        n = FAULT_COUNT * (FAULT_COUNT + NUISANCE_COUNT + 1)
        sums = self._total[n:] - self._before[self._candidate(finding.onset)][n:]
        return float(sums[finding.fault] / sums[-1])

    def _scores(self, chosen: NDArray[np.int64]) -> Array:
        """Return what `_scan` fills; beside no other fault it is asked for often, and kept."""
        alone = chosen[0] < 0
        if alone and self._alone is not None:
            return self._alone
        scores = np.empty((self._onsets, FAULT_COUNT, 4))
        inverse = np.linalg.inv(self._ff)
        solved = np.einsum("nm,m->n", inverse, self._fy)
        _scan(inverse, solved, self._total, self._before, self._onsets, chosen, scores)
        if alone:
            self._alone = scores
        return scores

    def _misfit(self) -> float:
        return self._yy - float(self._fy @ np.linalg.solve(self._ff, self._fy))

    def _candidates(self, chosen: NDArray[np.int64], first_flow: float) -> _Candidates:
        """Weigh every fault at every onset, beside a fault that is `chosen` already."""
        scores = self._scores(chosen)
        size = scores[..., 2] / scores[..., 3]
        visible = (scores[..., 0] > 0.0) & (size > 0.0) & (scores[..., 3] >= WITNESSES)
        visible[:, np.arange(FAULT_COUNT) == chosen[0]] = False
        information = np.where(visible, scores[..., 0], 1.0)
        coefficient = np.where(visible, scores[..., 1] / information, 0.0)
        explained = np.where(coefficient > 0.0, coefficient * scores[..., 1], 0.0)
        weight = NOISE_WEIGHT + 2 * self._blocks
        misfit = NOISE_WEIGHT + self._misfit() - self._explained_by(chosen)
        variance = np.maximum((misfit - explained) / weight, _LEAST_VARIANCE)
        flow_budget = np.hypot(np.array(FLOW_BUDGET), RELATIVE_BUDGET * first_flow)
        budget = np.where(visible, flow_budget / np.where(visible, size, 1.0), 0.0)
        return _Candidates(
            coefficient,
            np.sqrt(variance / information + budget**2),
            budget,
            weight * np.log1p(explained / (weight * variance)),
        )

    def _best(self, chosen: NDArray[np.int64], first_flow: float) -> Finding | None:
        """Return the likeliest fault beside `chosen` that passes the test, or None."""
        found = self._candidates(chosen, first_flow)
        limit = self.threshold(NOISE_WEIGHT + 2 * self._blocks)
        # What another cause explains far better is not this one, even if that is below its budget.
        rivalled = found.gain < found.gain.max() - _RIVAL_GAIN
        passing = ~rivalled & (found.coefficient > limit * found.deviation)
        gain = np.where(passing, found.gain, 0.0)
        for i in map(int, np.argsort(-gain.max(axis=0))):
            j = int(np.argmax(gain[:, i]))
            if gain[j, i] <= 0.0:
                return None
            onset, k = int(self._onset_blocks[j]), float(found.coefficient[j, i])
            jackknife = self._jackknife(i, onset, k, chosen)
            deviation = max(float(found.deviation[j, i]), hypot(jackknife, found.budget[j, i]))
            if k > limit * deviation:
                fraction = self._fraction(i, onset, k)
                return Finding(i, onset, fraction, k, deviation, k / deviation, float(gain[j, i]))
        return None

    def _jackknife(
        self, fault: int, onset: int, coefficient: float, chosen: NDArray[np.int64]
    ) -> float:
        """Return a coefficient's standard error, from the blocks' own residuals.

        Noise may differ from block to block (jackknife form of Eicker, Huber and White; both
        chambers of a block together). It is large when few blocks speak for the fault: no single
        block can raise an alarm.
        """
        y = np.array([block[0] for block in self._history])
        f = np.array([block[1] for block in self._history])
        columns = [np.array([block[2][:, fault] for block in self._history])]
        columns[0][:onset] = 0.0
        if chosen[0] >= 0:
            other = np.array([block[2][:, chosen[0]] for block in self._history])
            other[: self._onset_blocks[chosen[1]]] = 0.0
            columns.append(other)
        inverse = np.linalg.inv(self._ff)
        clean = [u - np.einsum("bcn,nm,m->bc", f, inverse, np.einsum("bcn,bc->n", f, u))
                 for u in columns]  # fmt: skip
        residual = y - np.einsum("bcn,nm,m->bc", f, inverse, self._fy) - coefficient * clean[0]
        if len(clean) > 1:
            cross = (clean[0] * columns[1]).sum() / (clean[1] * columns[1]).sum()
            clean[0] = clean[0] - cross * clean[1]
            residual -= (clean[1] * residual).sum() / (clean[1] * columns[1]).sum() * clean[1]
        information = (clean[0] * columns[0]).sum()
        leverage = np.minimum((clean[0] * columns[0]).sum(axis=1) / information, 0.999)
        influence = (clean[0] * residual).sum(axis=1) / information / (1.0 - leverage)
        return float(np.sqrt((influence**2).sum()))

    def _explained_by(self, chosen: NDArray[np.int64]) -> float:
        if chosen[0] < 0:
            return 0.0
        scores = self._scores(np.array([-1, 0]))
        information, projection = scores[chosen[1], chosen[0], :2]
        return float(projection * projection / information)

    def _fraction(self, fault: int, onset: int, coefficient: float) -> float:
        """Part of the block before the onset in which the fault was there already."""
        if onset == 0:
            return 0.0
        nuisance = np.linalg.solve(self._ff, self._fy)
        y, f, faults = self._history[onset - 1]
        signature = coefficient * faults[:, fault]
        rest = y - np.einsum("ij,j->i", f, nuisance)
        return float(np.clip((rest * signature).sum() / (signature**2).sum(), 0.0, 1.0))
