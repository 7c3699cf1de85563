"""The sequential test that finds faults in the oil accounts at a stated rate of false alarms.

At the end of every block the missing flows of all blocks so far are explained by

    missing = nuisances + coefficient x fault signature from an onset on + noise,

for each fault and each onset (generalised likelihood ratio over the onset, Basseville and Nikiforov
1993, ch. 7). A wandering spool null can look like a small flow, the dead zone. The test statistic
is therefore the flow beyond the dead zone, divided by its standard error; it follows Student's t.
docs/detection.md has the formulae.
"""

from collections.abc import Iterator
from dataclasses import replace
from math import pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    BLOCK_S,
    FAULT_COUNT,
    NUISANCE_COUNT,
    NUISANCES,
    RELATIVE_DEAD_ZONE,
    SUPPLY_LEAKAGE,
    UNINFORMED,
    AccountBlock,
    AccountSums,
    NuisanceBelief,
    Ramp,
    RecentBlocks,
    between,
    checked_model_error,
    dead_zones,
    lasting_noise,
    least_variance,
    noise_limit,
    nuisance_index,
    student_quantile,
    whitening,
)

from .fault_scores import RIVAL_GAIN, WITNESSES, Candidates, score_faults
from .fault_size import LEAST_BLOCKS, FaultSizes, Sudden
from .finding import Finding
from .growing import DURATIONS_S, RAMP_PART, grown_leak, grown_ramp, ramp_of

Array = NDArray[np.float64]

MINIMUM_BLOCKS: Final = 16
"""Fewest blocks (8 s) with which a fault is claimed. Their 32 values outnumber the nuisances and a
fault, so that some are left for an estimate of the noise."""
GROWTH_BLOCKS: Final = 8
"""Blocks (4 s) from one search for leaks that grow slowly to the next."""
RAMP_BLOCKS: Final = 4
"""Blocks (2 s) from one search of all ramps to the next; in between the last one is refined."""
SHARES: Final = FAULT_COUNT + 1
"""Number of tests among which the stated rate is divided if the supply pressure is measured: one of
each fault, and that of the supply pressure (`supply_statistic`)."""
DIRECTIONS: Final = 2.0
"""Effective number of independent faults that noise can be mistaken for. Simulations give 0.8 to
1.6, which is rounded up (`tools/studies/alarm_threshold.py`)."""
LEFT_OUT: Final = 0.3
"""Amount by which the statistic is lower because the block that supports the fault most is left
out, from the same simulations."""
TIED_GAIN: Final = 2.0
"""Gain in twice the log likelihood (odds e) up to which causes are as likely as each other. A fault
of the lines is like a leak of one chamber while the valve joins only that one to the line."""
TWO_WITNESSES: Final = 2 * WITNESSES
"""Fewest blocks since the earlier of two faults began, four for each. Four blocks, of which the
first ones are from before a leak, fit two faults that begin together better than any single one."""
_OF_LINES: Final = np.arange(FAULT_COUNT) >= SUPPLY_LEAKAGE
_NULL_BIAS: Final = nuisance_index("spool_null_bias")


class LeakTest:
    """Tests all blocks added so far for faults, at a stated rate of false alarms.

    Time and memory of a test do not grow with the number of blocks (`estimator.accounts.sums`).

    Args:
        false_alarms_per_day: alarms a healthy rig may raise in a day of continuous running.
        expected: mean and covariance of the nuisances before any block.
        model_error: factor on what is allowed for errors of the model: the dead zones, noise beyond
            the sensors' own, noise that lasts, doubts of an account, a null that shifts, and a
            limit as if all onsets were independent. 1 is what rigs unlike the model were found to
            need; 0 means that the model is exact.

    Raises:
        ValueError: the rate is not above 0 and at most 10000, or the factor not within 0 to 10.

    Attributes:
        sums: sums over the complete blocks that were added.
        dead_zone: flow in L/min that each fault must exceed to be claimed, float64 (5,).
        relative_dead_zone: part of a found fault's flow that a second fault must also exceed.
    """

    def __init__(
        self,
        false_alarms_per_day: float,
        expected: NuisanceBelief = UNINFORMED,
        model_error: float = 1.0,
    ) -> None:
        if not 0.0 < false_alarms_per_day <= 1e4:
            raise ValueError(
                f"false_alarms_per_day: {false_alarms_per_day} is outside 0 to 10000 per day"
            )
        self.false_alarms_per_day = false_alarms_per_day
        self.model_error = checked_model_error(model_error)
        self.dead_zone = dead_zones(model_error)
        self.relative_dead_zone = model_error * RELATIVE_DEAD_ZONE
        self._least_variance = least_variance(model_error)
        # Part of `NULL_SHIFT` by which the spool's null may shift where a fault begins.
        self._null_shift = self.model_error
        self.sums = AccountSums()
        self._expected = expected
        self._root = np.linalg.cholesky(expected.covariance)
        self._recent = RecentBlocks()
        self._kept: frozenset[int] = frozenset()
        self._growing: Finding | None = None
        # The ramp that was the likeliest in the last search for one, at which the next may begin,
        # and the number of blocks from which on all are tried again.
        self._ramp: Ramp | None = None
        self._next_ramps = 0
        # Scores after the last block. The key is the known fault, its onset and its growth, or None
        # (alone).
        self._scored: dict[tuple[int, int, Ramp | None] | None, Candidates] = {}
        self._findings: list[Finding] | None = None
        self._found_last: list[Finding] = []
        self._healthy_noise: float | None = None
        self._belief: NuisanceBelief | None = None
        self._sized: dict[Sudden, Finding] = {}

    @property
    def blocks(self) -> int:
        """Return how many complete blocks were added."""
        return self.sums.blocks

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        """Return the value of the statistic that a healthy rig exceeds at the stated rate.

        By default (`model_error` 1 or more) the rate is divided among all faults and onsets as if
        they were independent; this is Bonferroni's bound, so the true rate is lower. For an exact
        model (0) the dependence is taken into account (`estimator.accounts.crossings`). Values
        between 0 and 1 interpolate.

        Args:
            freedom: degrees of freedom of the estimated noise variance.
            part: part of the stated rate at which it may be exceeded.
        """
        per_block = part * self.false_alarms_per_day * BLOCK_S / 86400.0
        shares = SHARES if self.sums.supply_measured else FAULT_COUNT
        looks = shares * max(self.sums.marks, 1)
        bound = student_quantile(min(per_block / looks, 0.25), freedom)
        if self.model_error >= 1.0:
            return bound
        rate = per_block * FAULT_COUNT / shares / DIRECTIONS
        most = max(self.blocks, MINIMUM_BLOCKS)
        exact = noise_limit(rate, WITNESSES, most, freedom) - LEFT_OUT
        return between(exact, bound, self.model_error)

    def sharpness(self) -> float:
        """Return the factor by which a statistic is reduced before it counts as a normal score.

        It is 1 unless the test has learnt that this rig's statistics go further than noise does.
        """
        return 1.0

    def limit(self) -> float:
        """Return the value that the statistic of a first fault must exceed after the last block."""
        return self.threshold(self.candidates().regression.freedom)

    def limit_beside(self, freedom: float) -> float:
        """Return what a fault beside another must exceed: `threshold`, or the limit for noise."""
        return self.threshold(freedom)

    def change_limit(self) -> float:
        """Return what the root of the gain of a change of a found fault must exceed (`Candidates`).

        It is `limit`, unless the test has learnt a limit that is lower than that for noise.
        """
        return self.limit()

    def add(self, block: AccountBlock) -> None:
        """Add one block; an incomplete one is ignored."""
        if not block.complete:
            return
        rows = self._in_noise(block)
        self._recent.add(*rows)
        self.sums.add(block, rows, self._kept)
        self._scored.clear()
        self._sized.clear()
        self._findings = self._healthy_noise = self._belief = None

    def _in_noise(self, block: AccountBlock) -> tuple[Array, Array, Array]:
        """Return a block's missing flow (2,), nuisances (2, n) and faults with null shift (2, 6).

        They are in units of the block's expected noise. The nuisances are in units of what is known
        of them before any block, and the missing flow is without their expected mean.
        """
        white = self._whitening(block)
        nuisances = white @ block.nuisances
        missing = white @ block.missing - nuisances @ self._expected.mean
        # The spool's null may shift just where a fault begins; a fault must explain more than that.
        shift = self._null_shift * block.nuisances[:, _NULL_BIAS]
        shapes = white @ np.column_stack([block.faults, shift])
        return missing, nuisances @ self._root, shapes

    def _whitening(self, block: AccountBlock) -> Array:
        """Return the matrix (2, 2) that scales a block's expected noise to unit variances."""
        return whitening(block, self.model_error)

    def search(self) -> list[Finding]:
        """Return the faults found in all blocks so far, at most two; [] before `MINIMUM_BLOCKS`."""
        if self._findings is None:
            self._findings = self._search() if self.blocks >= MINIMUM_BLOCKS else []
            self._found_last = self._findings
            # Marks around an onset are kept: the onset stays exact, and 4 blocks (2 s) after it
            # the average of the leak's flow begins.
            self._kept = frozenset(f.onset + k for f in self._findings for k in range(-1, 6))
        return self._findings

    def _search(self) -> list[Finding]:
        sudden = self._sudden()
        grown = self._grown(sudden)
        return sudden or self._slow() if grown is None else [grown]

    def _grown(self, sudden: list[Finding]) -> Finding | None:
        """Return the leak that grew within the blocks so far, if sudden faults explain far less.

        It is looked for where sudden faults explain something, but are not sure or leave much.

        Args:
            sudden: the sudden faults that were found, at most two.
        """
        candidates = self.candidates()
        explained = float(candidates.gain.max())
        if explained < RIVAL_GAIN:
            return None
        if sudden:
            first = sudden[0]
            beside = self.candidates(first)
            if max(beside.gain.max(), beside.change.max()) < RIVAL_GAIN:
                return None
            alone = float(candidates.gain[self.mark(first), first.fault])
            explained = max(explained, alone + sum(each.likelihood for each in sudden[1:]))
        limit = self.threshold(candidates.regression.freedom, RAMP_PART / len(DURATIONS_S))
        if self.blocks < self._next_ramps and self._ramp is None:
            return None
        begin = self._ramp
        if self.blocks >= self._next_ramps:
            begin, self._next_ramps = None, self.blocks + RAMP_BLOCKS
        likely = grown_ramp(self.sums, self._least_variance, begin)
        self._ramp = None if likely is None else ramp_of(self.sums, likely)
        if likely is None or likely.gain <= explained + RIVAL_GAIN:
            return None
        grown = grown_leak(self.sums, self._recent, likely, self.dead_zone, self.model_error)
        return replace(grown, limit=limit) if grown.statistic > limit else None

    def _sudden(self) -> list[Finding]:
        """Return the sudden faults found in all blocks so far, at most two."""
        first = self.best()
        if first is None:
            return self._pair()
        second = self._second(first)
        if second is not None:
            return [self.beside(first, second), second]
        # Two leaks at once may look like one fault of the lines, which explains a little of both.
        pair = self._pair() if first.fault >= SUPPLY_LEAKAGE else self._pair_again()
        if pair and self._explained(*pair) > first.likelihood + RIVAL_GAIN:
            return pair
        return [first]

    def _second(self, first: Finding) -> Finding | None:
        """Return the fault that stands out most beside another; None if the blocks are too few."""
        second = self.best(first)
        if second is None or self.blocks - min(first.onset, second.onset) < TWO_WITNESSES:
            return None
        return second

    def _explained(self, first: Finding, second: Finding) -> float:
        """Return the gain in twice the log likelihood of two faults that are fitted together.

        The likelihood of the second finding must be that beside the first one.
        """
        alone = self.candidates().gain[self.mark(first), first.fault]
        return float(alone) + second.likelihood

    def _pair(self) -> list[Finding]:
        """Return two faults of which each stands out only beside the other; [] if there are none.

        While only one is fitted, the other one counts as noise and hides it.
        """
        pairs = []
        for likely in self.likely():
            second = self._second(likely)
            first = None if second is None else self._second(second)
            if first is not None and second is not None:
                pairs.append([first, second])
        return max(pairs, key=lambda pair: sum(f.likelihood for f in pair), default=[])

    def _pair_again(self) -> list[Finding]:
        """Return the last search's two faults if each still stands out beside the other, or [].

        The fault that explains most alone may begin at another time than it does beside the second
        one, as it then explains a part of that, and hides it.
        """
        if len(self._found_last) < 2:
            return []
        second = self._second(self._found_last[0])
        first = None if second is None else self._second(second)
        return [] if first is None or second is None else [first, second]

    def _slow(self) -> list[Finding]:
        """Return a leak that grows over minutes, or []; searched for every `GROWTH_BLOCKS` blocks.

        Between two searches the result of the last one is returned.
        """
        if self.blocks >= LEAST_BLOCKS and self.blocks % GROWTH_BLOCKS == 0:
            variance = self.candidates().regression.variance
            limit = self.limit()
            grown = self._sizes().grown(variance, self.dead_zone, limit)
            self._growing = grown and replace(grown, limit=limit)
        return [] if self._growing is None else [self._growing]

    def likely(self) -> Iterator[Finding]:
        """Yield each fault whose gain is `RIVAL_GAIN` or more, greatest gain first.

        The gain is that in twice the log likelihood. A fault may be noise, as its statistic may be
        below the limit. `likelihood` and `limit` of these findings are left at 0. Each is sized
        once it is asked for, before the next block.
        """
        candidates = self.candidates()
        for fault in np.argsort(-candidates.gain.max(axis=0)):
            mark = int(np.argmax(candidates.gain[:, fault]))
            if candidates.gain[mark, fault] < RIVAL_GAIN:
                break
            variance = float(candidates.scores.variance[mark, fault])
            dead = self.dead_zone[fault]
            yield self._sizes().sudden(int(fault), mark, None, dead, variance)

    def beside(self, first: Finding, second: Finding) -> Finding:
        """Return the first fault with its size fitted anew, beside a second one found later.

        The second finding may also be a later change of the same fault.
        """
        at = self.mark(second), second.fault
        variance = float(self.candidates(first).scores.variance[at])
        dead = self.dead_zone[first.fault]
        again = self._sizes().sudden(first.fault, self.mark(first), second, dead, variance)
        return replace(again, likelihood=first.likelihood, limit=first.limit)

    def nuisances(self) -> NuisanceBelief:
        """Return the nuisances estimated from the blocks so far, beside the first fault found.

        Before any block they are those expected.
        """
        if not self.blocks:
            return self._expected
        if self._belief is None:
            n = NUISANCE_COUNT
            first = next(iter(self.search()), None)
            mean, covariance = self.candidates(first).regression.nuisances()
            self._belief = NuisanceBelief(
                self._expected.mean + self._root @ mean[:n],
                self._root @ covariance[:n, :n] @ self._root.T,
            )
        return self._belief

    def null_bias(self) -> tuple[float, float]:
        """Return the spool's null bias less the model's, and its standard deviation, both in m."""
        sigma, belief = NUISANCES[_NULL_BIAS].sigma, self.nuisances()
        spread = sqrt(belief.covariance[_NULL_BIAS, _NULL_BIAS])
        return sigma * float(belief.mean[_NULL_BIAS]), sigma * spread

    def healthy_noise(self) -> float:
        """Return the factor by which lasting noise raises a coefficient's variance without a fault.

        It is `lasting_noise` of the residuals that the nuisances alone leave.
        """
        if self._healthy_noise is None:
            residuals = self._recent.residuals(self.candidates().regression.nuisances()[0])
            self._healthy_noise = lasting_noise(residuals, self.model_error)
        return self._healthy_noise

    def candidates(self, beside: Finding | None = None) -> Candidates:
        """Return the scores of every fault from every mark on, after the last block.

        Faults are scored alone, or beside a fault that was found, which is then fitted along.
        """
        key = None if beside is None else (beside.fault, beside.onset, beside.ramp)
        if key not in self._scored:
            self._scored[key] = self._scores(beside)
        return self._scored[key]

    def _scores(self, beside: Finding | None) -> Candidates:
        return score_faults(self.sums, self._least_variance, beside)

    def best(self, beside: Finding | None = None) -> Finding | None:
        """Return the fault with the greatest gain whose statistic exceeds the limit; else None.

        The gain is that in twice the log likelihood. A fault does not count if another cause has a
        gain greater by more than `RIVAL_GAIN`. A leak is preferred to a fault of the lines that is
        as likely (`TIED_GAIN`).

        Args:
            beside: a fault that was found and is fitted along; None for the first fault.
        """
        candidates = self.candidates(beside)
        dead_zone = self.dead_zone
        if beside is not None:
            flow = beside.coefficient * candidates.products.sizes[self.mark(beside), beside.fault]
            dead_zone = np.maximum(dead_zone, self.relative_dead_zone * flow)
        freedom = candidates.regression.freedom
        limit = self.threshold(freedom) if beside is None else self.limit_beside(freedom)
        gain, marks = self._standing_out(beside, limit, dead_zone)
        for fault in np.argsort(TIED_GAIN * _OF_LINES - gain) if gain.any() else ():
            mark = int(marks[fault])
            if gain[fault] <= 0.0:
                continue
            variance = float(candidates.scores.variance[mark, fault])
            finding = self._sizes().sudden(int(fault), mark, beside, dead_zone[fault], variance)
            if finding.statistic > limit:
                return replace(finding, likelihood=float(gain[fault]), limit=limit)
        return None

    def _standing_out(
        self, beside: Finding | None, limit: float, dead_zone: Array
    ) -> tuple[Array, NDArray[np.int64]]:
        """Return the greatest gain of each fault among its candidates that stand out, and its mark.

        Both are (5,); a gain is 0 if none stands out.

        Args:
            beside: a fault that was found and is fitted along, or None.
            limit: value that the statistic must exceed.
            dead_zone: flow in L/min that each fault must exceed, (5,).
        """
        candidates = self.candidates(beside)
        scores, sizes, usable = candidates.scores, candidates.products.sizes, candidates.usable
        error = scores.variance / np.where(usable, scores.information, 1.0)
        dead = dead_zone / np.where(usable, sizes, 1.0)
        sure = scores.coefficient > limit * np.sqrt(error) + dead
        # A fault is dropped if another cause explains far more, even one below its own limit. A
        # change of the fault that was found counts as another cause.
        best = max(candidates.gain.max(), candidates.change.max())
        likely = candidates.gain >= best - RIVAL_GAIN
        gain = np.where(sure & likely, candidates.gain, 0.0)
        return gain.max(axis=0), np.argmax(gain, axis=0)

    def log_evidence(self, lasting: float, greatest_flow: float) -> Array:
        """Return the logarithm of each fault's likelihood beside none, summed over onsets: (5,).

        Every flow up to `greatest_flow` is equally probable. A flow within the dead zone is no
        evidence of a fault.

        Args:
            lasting: factor by which lasting noise raises the variance of a coefficient.
            greatest_flow: L/min.
        """
        candidates = self.candidates()
        scores, usable = candidates.scores, candidates.usable
        size = np.where(usable, candidates.products.sizes, 1.0)
        error = np.sqrt(scores.variance * lasting / np.where(usable, scores.information, 1.0))
        surplus = np.maximum(scores.coefficient - self.dead_zone / size, 0.0) / error
        surplus *= self.sharpness()
        width = np.log(sqrt(2.0 * pi) / greatest_flow * size * error)
        logs = np.where(usable, 0.5 * surplus**2 + np.minimum(width, 0.0), -np.inf)
        return np.asarray(np.logaddexp.reduce(logs, axis=0))

    def likeliest(self) -> Finding | None:
        """Return the fault with the greatest gain, even if it may be noise.

        It would be claimed if its statistic exceeded its limit. The result is None if no fault
        explains anything, or with fewer than `MINIMUM_BLOCKS` blocks.
        """
        candidates = self.candidates()
        if self.blocks < MINIMUM_BLOCKS or not candidates.gain.max() > 0.0:
            return None
        scores, limit = candidates.scores, self.limit()
        mark, fault = np.unravel_index(int(np.argmax(candidates.gain)), candidates.gain.shape)
        variance = float(scores.variance[mark, fault])
        dead = self.dead_zone[fault]
        likeliest = self._sizes().sudden(int(fault), int(mark), None, dead, variance)
        error = sqrt(variance / float(scores.information[mark, fault]))
        surplus = scores.coefficient[mark, fault] - dead / candidates.products.sizes[mark, fault]
        statistic = min(likeliest.statistic, float(surplus) / error)
        return replace(likeliest, statistic=statistic, limit=limit)

    def mark(self, finding: Finding) -> int:
        """Return the index of the mark at which a found fault begins."""
        return self.sums.mark_of(finding.onset)

    def _sizes(self) -> FaultSizes:
        return FaultSizes(
            self.sums, self.candidates().products, self._recent, self.model_error, self._sized
        )
