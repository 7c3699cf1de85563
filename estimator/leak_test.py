"""The sequential test for faults in the oil accounts: which fault, since when, how large, how sure.

At the end of every block the missing flows of all blocks so far are explained by

    missing = nuisances + coefficient x fault signature from an onset on + noise,

for each fault and each onset (generalised likelihood ratio over the onset, Basseville and Nikiforov
1993, ch. 7). A fault is claimed for what its flow exceeds a dead zone by, the flow that a wandering
spool null could feign: that surplus over its standard error follows Student's t. docs/detection.md
has the formulae.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, log, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant.parameters import LITRE_PER_MINUTE

from .account_regression import Regression, Scores, least_variance
from .account_row import FAULT_COUNT, INTERNAL_LEAKAGE, SUPPLY_LEAKAGE
from .account_sums import MARKS, SHIFT, AccountSums, FaultProducts
from .block_noise import RecentBlocks, lasting_noise
from .crossings import between, noise_limit, student_quantile
from .flow_account import BLOCK_S, AccountBlock
from .growth import LEAST_BLOCKS, growths
from .joint_fit import JointFit
from .nuisances import NUISANCE_COUNT, NUISANCES, nuisance_index

Array = NDArray[np.float64]

NOISE: Final = 0.01
"""Expected noise of one block's missing flow by errors of the model, L/min."""
SENSOR_ERRORS: Final = {
    "spool_null_bias": 2.9e-8,
    "pressure_1_bias": 1.4e3,
    "pressure_2_bias": 1.4e3,
}
"""What sensors' noise makes of the means over a block, one standard deviation, m and Pa: 1 um and
30 kPa a sample over 500 of them; the filter takes two fifths off the spool's (docs/detection.md).
They enter an account as the nuisances of that name do, both chambers at once."""
OWN_NOISE: Final = 0.0006
"""L/min, of each chamber beside that: what the ends of a block are not known by."""
DEAD_ZONE: Final = (0.01, 0.01, 0.015, 0.04, 0.04)
"""Flow in L/min that no fault is claimed for, by fault: what the model may still be wrong by after
the nuisances. 0.1 um of metering edge is 0.01 L/min; edges near null, where a ram that is held
works, look most like an internal leak; supply and return pressures wander by more than leaks."""
_DEAD_ZONE: Final = np.array(DEAD_ZONE)
_LEAST_PART: Final = np.array([0.0, 0.0, 0.0, 0.25, 0.25])
"""Of the dead zone, that stays if a model errs less than usual: what supply and return do is not
linear in their tolerances, by which the accounts follow them."""
RELATIVE_DEAD_ZONE: Final = 0.05
"""Beside a fault, another one must exceed this part of its flow too, and a fault that is down to it
has gone: the leak law is not exact."""
MINIMUM_BLOCKS: Final = 16
"""Before that many nobody is accused, 8 s of motion: their 32 values outnumber the nuisances and a
fault, so that some are left to tell the noise by."""
PRIOR: Final = 0.01
"""Probability before any data, of each fault, that a run has it."""
GREATEST_FLOW: Final = 4.0
"""L/min: before any data a fault's flow may be anything up to this (figure 5.1: bypass lines)."""
WITNESSES: Final = 4
"""Blocks that must speak for a fault: from fewer, their spread cannot be told."""
GREAT_FLOW: Final = 0.5
"""L/min: where a greater leak opens, pressures fall by more than straight lines hold for."""
SETTLING_BLOCKS: Final = 2
"""Such a leak is sized without the first blocks, once twice the witnesses have spoken."""
GROWTH_BLOCKS: Final = 8
"""Blocks, 4 s, from one search for leaks that grow slowly to the next."""
ONSETS: Final = MARKS
"""Onsets that are told apart."""
SHARES: Final = FAULT_COUNT + 1
"""What shares the stated rate where the supply pressure is measured: the faults, and the test of
that pressure (`supply_test`)."""
DIRECTIONS: Final = 2.0
"""Faults that noise could be taken for, in effect: 0.8 to 1.6 by simulation, rounded up
(`tools/alarm_threshold.py`)."""
LEFT_OUT: Final = 0.3
"""What the statistic is lower by for leaving out the block that speaks most: likewise."""
_RIVAL_GAIN: Final = 20.0
"""Twice the log likelihood by which a rival cause must win to be preferred: odds of e^10."""
MOST_MODEL_ERROR: Final = 10.0
"""Greatest factor on what is allowed for errors of the model."""
_NULL_BIAS: Final = nuisance_index("spool_null_bias")
_SENSORS: Final = [nuisance_index(name) for name in SENSOR_ERRORS]
_IN_SIGMAS: Final = np.array(
    [
        error / NUISANCES[at].sigma
        for error, at in zip(SENSOR_ERRORS.values(), _SENSORS, strict=True)
    ]
)
_SETTLED_PART: Final = 0.8
"""Noise that a fault explains this much of was mostly that fault: it is estimated anew."""


def checked_model_error(model_error: float) -> float:
    """Return a factor on what is allowed for errors of the model.

    Raises:
        ValueError: it is not within 0 to `MOST_MODEL_ERROR`.
    """
    if not 0.0 <= model_error <= MOST_MODEL_ERROR:
        raise ValueError(
            f"model_error: {model_error} is outside 0 (the model is exact) to {MOST_MODEL_ERROR:g}"
        )
    return model_error


def sensor_noise(block: AccountBlock) -> Array:
    """Return the covariance (2, 2) of what sensors make of a block's missing flows, (m^3/s)^2."""
    errors = block.nuisances[:, _SENSORS] * _IN_SIGMAS
    own = (OWN_NOISE * LITRE_PER_MINUTE) ** 2
    return np.asarray(errors @ errors.T + own * np.eye(2))


@dataclass(frozen=True)
class NuisanceBelief:
    """Mean (n,) and covariance (n, n) of the nuisances, each in units of its tolerance."""

    mean: Array
    covariance: Array


UNINFORMED: Final = NuisanceBelief(np.zeros(NUISANCE_COUNT), np.eye(NUISANCE_COUNT))
"""Nothing known but the tolerances."""


@dataclass(frozen=True)
class Finding:
    """One fault in the accounts.

    Attributes:
        fault: index into `FAULTS`.
        onset: index of the first complete block with the fault.
        onset_fraction: part of the block before that already had it, 0 to 1.
        coefficient, deviation: its coefficient and standard error, SI.
        statistic: what its flow exceeds the dead zone by, over its standard error, without the
            block that speaks most for it.
        likelihood: gain in twice the log likelihood, in units of the noise.
        onset_s: time at which it began.
        lasting: by how much noise that lasts from block to block has raised its variance.
        grown: of a leak that grows, its coefficient at last, `coefficient` being the mean since it
            exceeded the dead zone; else None.
    """

    fault: int
    onset: int
    onset_fraction: float
    coefficient: float
    deviation: float
    statistic: float
    likelihood: float
    onset_s: float
    lasting: float
    grown: float | None = None


@dataclass(frozen=True)
class _Candidates:
    """Every fault from every mark on.

    Attributes:
        regression: of the missing flow on nuisances, and on the fault that was found, if any.
        products: sums of the faults' products since each mark.
        scores: what each fault would do for the regression.
        usable: bool (marks, 5), whether it can be told at all.
        gain: float64 (marks, 5), its gain in twice the log likelihood; 0 where it is not usable.
        change: float64 (marks,), that of a change of the fault beside which these are.
    """

    regression: Regression
    products: FaultProducts
    scores: Scores
    usable: NDArray[np.bool_]
    gain: Array
    change: Array


class LeakTest:
    """Tests the blocks it is given, one at a time, at a stated false-alarm rate.

    Time and memory of a test do not grow with the number of blocks (`estimator.account_sums`).

    Args:
        false_alarms_per_day: alarms a healthy rig may raise in a day of continuous running.
        expected: what is believed of the nuisances before any block.
        model_error: factor on what is allowed for errors of the model: the dead zones, noise beyond
            the sensors' own, noise that lasts, doubts of an account, a null that shifts, a limit
            as if all looks were independent. 1: what rigs unlike the model were found to need;
            0: the model is exact.

    Raises:
        ValueError: the rate is not above 0 and at most 10000, or the factor not within 0 to 10.
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
        self._dead_zone = np.maximum(model_error, _LEAST_PART) * _DEAD_ZONE
        self._relative_dead_zone = model_error * RELATIVE_DEAD_ZONE
        self._least_variance = least_variance(model_error)
        self.sums = AccountSums()
        self._expected = expected
        self._root = np.linalg.cholesky(expected.covariance)
        self._recent = RecentBlocks()
        self._kept: frozenset[int] = frozenset()
        self._growing: Finding | None = None
        # As of the last block: by the fault (and its onset) beside which others are looked for.
        self._scored: dict[tuple[int, int] | None, _Candidates] = {}
        self._findings: list[Finding] | None = None
        self._healthy_noise: float | None = None

    @property
    def blocks(self) -> int:
        """How many complete blocks were tested."""
        return self.sums.blocks

    def threshold(self, freedom: float) -> float:
        """Return the value of the statistic that a healthy rig exceeds at the stated rate.

        Where the model is exact the rate is shared out over the faults, as many of them as count,
        and over all onsets (`estimator.crossings`), less what leaving out a block takes from a
        statistic. By default it is shared out as if all were independent (Bonferroni's bound, so
        the true rate is lower).
        """
        per_block = self.false_alarms_per_day * BLOCK_S / 86400.0
        shares = SHARES if self.sums.supply(0)[0] else FAULT_COUNT
        looks = shares * max(self.sums.marks, 1)
        bound = student_quantile(min(per_block / looks, 0.25), freedom)
        rate = per_block * FAULT_COUNT / shares / DIRECTIONS
        most = max(self.blocks, MINIMUM_BLOCKS)
        exact = noise_limit(rate, WITNESSES, most, freedom) - LEFT_OUT
        return between(exact, bound, self.model_error)

    def limit(self) -> float:
        """Return what the statistic of a first fault has to exceed as of the last block."""
        return self.threshold(self._candidates().regression.freedom)

    def add(self, block: AccountBlock) -> None:
        """Take one more block; incomplete blocks only pass the time."""
        if not block.complete:
            return
        white = self._whitening(block)
        nuisances = white @ block.nuisances
        missing = white @ block.missing - nuisances @ self._expected.mean
        # A null that shifts may begin like a fault: a fault has to explain more than that.
        shift = self.model_error * block.nuisances[:, _NULL_BIAS]
        shapes = white @ np.column_stack([block.faults, shift])
        rows = missing, nuisances @ self._root, shapes
        self._recent.add(*rows)
        self.sums.add(block, rows, self._kept)
        self._scored.clear()
        self._findings = self._healthy_noise = None

    def _whitening(self, block: AccountBlock) -> Array:
        """Return what makes a block's expected noise white and 1, float64 (2, 2), s/m^3.

        Where nuisances may do more than their signatures say, the account counts for less.
        """
        model = np.full(2, self.model_error * NOISE * LITRE_PER_MINUTE)
        model = np.hypot(model, self.model_error * block.doubts)
        return np.linalg.inv(np.linalg.cholesky(sensor_noise(block) + np.diag(model**2)))

    def search(self) -> list[Finding]:
        """Return the faults found in all blocks so far: none, one, or two at once."""
        if self._findings is None:
            self._findings = self._search() if self.blocks >= MINIMUM_BLOCKS else []
            # Onsets stay as sharp as they were found; 4 blocks on, the flow is averaged.
            self._kept = frozenset(f.onset + k for f in self._findings for k in range(-1, 6))
        return self._findings

    def _search(self) -> list[Finding]:
        first = self._best()
        if first is None:
            return self._pair() or self._slow()
        second = self._best(first)
        if second is not None:
            return [self._beside(first, second), second]
        # Two leaks at once may pass for one fault of the lines, which explains both a little.
        pair = self._pair() if first.fault >= SUPPLY_LEAKAGE else []
        if pair and self._explained(*pair) > first.likelihood + _RIVAL_GAIN:
            return pair
        return [first]

    def _explained(self, first: Finding, second: Finding) -> float:
        """Return the gain in twice the log likelihood of two faults together."""
        alone = self._candidates().gain[self._mark(first), first.fault]
        return float(alone) + second.likelihood

    def _pair(self) -> list[Finding]:
        """Return two faults neither of which stands out while the other passes for noise."""
        pairs = []
        for likely in self._likely():
            second = self._best(likely)
            first = None if second is None else self._best(second)
            if first is not None and second is not None:
                pairs.append([first, second])
        return max(pairs, key=lambda pair: sum(f.likelihood for f in pair), default=[])

    def _slow(self) -> list[Finding]:
        """Return a leak that grows over minutes; looked for at some blocks, held in between."""
        if self.blocks >= LEAST_BLOCKS and self.blocks % GROWTH_BLOCKS == 0:
            self._growing = self._grown()
        return [] if self._growing is None else [self._growing]

    def _grown(self) -> Finding | None:
        products, regression = self._candidates().products, self._candidates().regression
        likeliest = growths(
            self.sums, products, self._recent, regression.variance, self.model_error
        )[0]
        fault, levels = likeliest.fault, likeliest.levels
        size = float(products.sizes[likeliest.marks[-1], fault])
        dead = self._dead_zone[fault] / size if size > 0.0 else inf
        statistic = (float(levels[-1]) - dead) / likeliest.deviation
        if not statistic > self.limit():
            return None
        below = np.flatnonzero(levels <= dead)
        first = int(below[-1]) + 1 if below.size else 0
        mark = int(likeliest.marks[first])
        return Finding(
            fault, int(self.sums.mark_blocks[mark]), 0.0, float(levels[first:].mean()),
            likeliest.deviation, statistic, statistic**2, self.sums.start_s(mark), 1.0,
            float(levels[-1]),
        )  # fmt: skip

    def _likely(self) -> list[Finding]:
        """Return each fault that explains much, likeliest first, whether it may be noise or not."""
        candidates = self._candidates()
        found = []
        for fault in np.argsort(-candidates.gain.max(axis=0)):
            mark = int(np.argmax(candidates.gain[:, fault]))
            if candidates.gain[mark, fault] < _RIVAL_GAIN:
                break
            variance = float(candidates.scores.variance[mark, fault])
            found.append(self._examined(int(fault), mark, None, self._dead_zone[fault], variance))
        return found

    def _beside(self, first: Finding, second: Finding) -> Finding:
        """Return a fault fitted anew beside another that was found after it."""
        at = self._mark(second), second.fault
        variance = float(self._candidates(first).scores.variance[at])
        dead = self._dead_zone[first.fault]
        again = self._examined(first.fault, self._mark(first), second, dead, variance)
        return replace(again, likelihood=first.likelihood)

    def leaks_beside(self, dropped: Finding) -> list[Finding]:
        """Return the leak that stands out beside a measured drop of the supply pressure, if any."""
        if self.blocks < MINIMUM_BLOCKS:
            return []
        mark = min(self.sums.mark_at(dropped.onset_s), self.sums.marks - 1)
        leak = self._best(replace(dropped, onset=int(self.sums.mark_blocks[mark])))
        return [] if leak is None or leak.fault >= SUPPLY_LEAKAGE else [leak]

    def may_be_lines(self, findings: Sequence[Finding]) -> bool:
        """Tell whether leaks found may be a fault of the supply or return line.

        Where the supply pressure is not measured, such a fault moves both accounts, as an internal
        leak does or two leaks. It is told by what it explains beside the first leak: next to
        nothing where that is the cause, and as much as a second leak where the lines are.
        """
        if not findings or self.sums.supply(0)[0]:
            return False
        if any(finding.fault >= SUPPLY_LEAKAGE for finding in findings):
            return True
        first, *others = findings
        if not others and first.fault != INTERNAL_LEAKAGE:
            return False
        beside = self._candidates(first).gain
        line = float(beside[:, SUPPLY_LEAKAGE:].max())
        second = max((float(beside[:, other.fault].max()) for other in others), default=0.0)
        return line >= (second - _RIVAL_GAIN if others else _RIVAL_GAIN)

    def nuisances(self) -> NuisanceBelief:
        """Return what the blocks so far say of the nuisances, beside the first fault in them."""
        if not self.blocks:
            return self._expected
        n = NUISANCE_COUNT
        first = next(iter(self.search()), None)
        mean, covariance = self._candidates(first).regression.nuisances()
        return NuisanceBelief(
            self._expected.mean + self._root @ mean[:n],
            self._root @ covariance[:n, :n] @ self._root.T,
        )

    def null_bias(self) -> tuple[float, float]:
        """Return the spool's null bias beside the model's, and its standard deviation, m."""
        sigma, belief = NUISANCES[_NULL_BIAS].sigma, self.nuisances()
        spread = sqrt(belief.covariance[_NULL_BIAS, _NULL_BIAS])
        return sigma * float(belief.mean[_NULL_BIAS]), sigma * spread

    def smallest(self, part: float = 0.5) -> Array:
        """Return the smallest coefficient of each fault (5,), SI, that would have been found.

        Args:
            part: part of the blocks after which the fault would have begun.
        """
        candidates = self._candidates()
        regression = candidates.regression
        mark = min(self.sums.mark_of(int(part * self.blocks)), self.sums.marks - 1)
        information = candidates.scores.information[mark]
        size = candidates.products.sizes[mark]
        visible = (information > 0.0) & (size > 0.0)
        if self._healthy_noise is None:
            residuals = self._recent.residuals(regression.nuisances()[0])
            self._healthy_noise = lasting_noise(residuals, self.model_error)
        lasting = self._healthy_noise
        error = regression.variance * lasting / np.where(visible, information, 1.0)
        dead = self._dead_zone / np.where(visible, size, 1.0)
        return np.where(visible, self.limit() * np.sqrt(error) + dead, np.inf)

    def present(self, finding: Finding) -> float:
        """Return a fault's coefficient as it is now, SI: another one if it has changed since.

        0 if it has gone: what is left is within the dead zone, the part of what there was that the
        leak law may be wrong by, or two standard errors.
        """
        if finding.grown is not None:
            return finding.grown
        candidates = self._candidates(finding)
        first, fault = self._mark(finding), finding.fault
        mark = int(np.argmax(candidates.change))
        if candidates.change[mark] < self.limit() ** 2:
            return finding.coefficient
        variance = float(candidates.scores.variance[mark, fault])
        faults, marks = [SHIFT, fault, fault], [mark, first, mark]
        fit = JointFit(self.sums, candidates.products, faults, marks, variance)
        size = float(candidates.products.sizes[mark, fault])
        left = float(fit.coefficients[1:].sum())
        dead = max(self._dead_zone[fault] / size, self._relative_dead_zone * finding.coefficient)
        return left if left > max(dead, 2.0 * sqrt(fit.error)) else 0.0

    def probabilities(self) -> Array:
        """Return the probabilities (7,) of no fault, of each fault alone, and of two of them.

        By Bayes' rule, with every onset as probable as any other and the coefficient anywhere up to
        `GREATEST_FLOW`; what a dead zone may hide speaks for no fault.
        """
        candidates = self._candidates()
        scores, usable = candidates.scores, candidates.usable
        lasting = next((fault.lasting for fault in self._likely()), 1.0)
        size = np.where(usable, candidates.products.sizes, 1.0)
        error = np.sqrt(scores.variance * lasting / np.where(usable, scores.information, 1.0))
        surplus = np.maximum(scores.coefficient - self._dead_zone / size, 0.0) / error
        width = np.log(sqrt(2.0 * pi) / GREATEST_FLOW * size * error)
        onsets = max(self.sums.marks, 1)
        logs = np.where(usable, 0.5 * surplus**2 + np.minimum(width, 0.0), -np.inf)
        each = np.logaddexp.reduce(logs, axis=0) + log(PRIOR / onsets)
        pair = -np.inf
        if len(findings := self.search()) > 1:
            flows = [
                f.deviation * candidates.products.sizes[self._mark(f), f.fault] for f in findings
            ]
            pair = sum(
                0.5 * f.statistic**2 + log(PRIOR / onsets * sqrt(2.0 * pi) / GREATEST_FLOW * flow)
                for f, flow in zip(findings, flows, strict=True)
            )
        healthy = log(1.0 - FAULT_COUNT * PRIOR)
        weights = np.concatenate([[healthy], each, [pair]])
        weights = np.exp(weights - weights.max())
        return np.asarray(weights / weights.sum())

    def _candidates(self, beside: Finding | None = None) -> _Candidates:
        """Score every fault from every mark on, beside one that was found."""
        key = None if beside is None else (beside.fault, beside.onset)
        if key not in self._scored:
            self._scored[key] = self._score(beside)
        return self._scored[key]

    def _score(self, beside: Finding | None) -> _Candidates:
        products = self.sums.faults_since()
        ff, fy, yy = self.sums.nuisances()
        crossed = products.crossed
        visible = (products.sizes > 0.0) & (products.blocks >= WITNESSES)[:, None]
        if beside is not None:
            ff, fy, crossed = _fault_as_nuisance(beside, self._mark(beside), products, ff, fy)
            visible[:, beside.fault] = False
        regression = Regression(ff, fy, yy, 2 * self.blocks, self._least_variance)
        variance = regression.variance
        for _ in range(3):
            scores = regression.score(crossed, products, variance)
            usable = visible & (scores.coefficient > 0.0)
            left = scores.variance.min(where=usable, initial=variance)
            if left > _SETTLED_PART * variance:
                break
            variance = float(left)
        freedom = regression.freedom
        gain = freedom * np.log1p(scores.explained / (freedom * scores.variance))
        change = np.zeros(products.blocks.size)
        if beside is not None:
            later = np.arange(change.size) > self._mark(beside)
            told = later & (products.blocks >= WITNESSES)
            change = np.where(told, gain[:, beside.fault], 0.0)
        return _Candidates(
            regression, products, scores, usable, np.where(usable, gain, 0.0), change
        )

    def _best(self, beside: Finding | None = None) -> Finding | None:
        """Return the fault that explains most, beside one found, if a healthy rig would not."""
        candidates = self._candidates(beside)
        scores, sizes, usable = candidates.scores, candidates.products.sizes, candidates.usable
        dead_zone = self._dead_zone
        if beside is not None:
            flow = beside.coefficient * sizes[self._mark(beside), beside.fault]
            dead_zone = np.maximum(dead_zone, self._relative_dead_zone * flow)
        limit = self.threshold(candidates.regression.freedom)
        error = scores.variance / np.where(usable, scores.information, 1.0)
        dead = dead_zone / np.where(usable, sizes, 1.0)
        sure = scores.coefficient > limit * np.sqrt(error) + dead
        # What another cause explains far better is not this one, even if that is below its limit;
        # a change of the fault that was found is such a cause.
        best = max(candidates.gain.max(), candidates.change.max())
        likely = candidates.gain >= best - _RIVAL_GAIN
        gain = np.where(sure & likely, candidates.gain, 0.0)
        for fault in np.argsort(-gain.max(axis=0)):
            mark = int(np.argmax(gain[:, fault]))
            if gain[mark, fault] <= 0.0:
                return None
            variance = float(scores.variance[mark, fault])
            finding = self._examined(int(fault), mark, beside, dead_zone[fault], variance)
            if finding.statistic > limit:
                return replace(finding, likelihood=float(gain[mark, fault]))
        return None

    def _lasting(
        self, faults: list[int], marks: list[int], variance: float, settling: int
    ) -> float:
        """Return by how much noise that lasts raises the variance of the last fault's coefficient.

        That the fault grows or shrinks is no noise: it may change at each third of its time.
        """
        since, blocks = marks[-1], self.sums.marks - marks[-1]
        if blocks >= 3 * WITNESSES:
            changes = [since + blocks // 3, since + 2 * blocks // 3]
            faults = [faults[-1], faults[-1], *faults]
            marks = [*changes, *marks]
        fit = JointFit(self.sums, self._candidates().products, faults, marks, variance, settling)
        onsets = [int(self.sums.mark_blocks[m]) for m in marks]
        present = list(zip(faults, onsets, fit.coefficients, strict=True))
        return lasting_noise(self._recent.residuals(fit.nuisances, present), self.model_error)

    def _mark(self, finding: Finding) -> int:
        return self.sums.mark_of(finding.onset)

    def _examined(
        self,
        fault: int,
        mark: int,
        beside: Finding | None,
        dead_zone: float,
        variance: float,
    ) -> Finding:
        """Return a fault from a mark on as a finding, fitted together with one beside it.

        Its standard error also holds for noise that differs or lasts from block to block, and the
        statistic is that without the block that speaks most for the fault.
        """
        products = self._candidates().products
        faults, marks = [SHIFT, fault], [mark, mark]
        if beside is not None:
            faults, marks = [SHIFT, beside.fault, fault], [mark, self._mark(beside), mark]
        size, settling = float(products.sizes[mark, fault]), 0
        fit = JointFit(self.sums, products, faults, marks, variance)
        if size * fit.coefficients[-1] > GREAT_FLOW and products.blocks[mark] >= 2 * WITNESSES:
            settling = SETTLING_BLOCKS
            fit = JointFit(self.sums, products, faults, marks, variance, settling)
        lasting = self._lasting(faults, marks, variance, settling)
        dead = dead_zone / size
        deviation = sqrt(max(fit.error, fit.uneven_error()) * lasting)
        coefficient = float(fit.coefficients[-1])
        # Whatever block is left out, the rest must speak for the fault.
        rest, error = fit.left_out()
        statistic = float(((rest - dead) / np.sqrt(error * lasting)).min())
        fraction = fit.began_before()
        onset_s = self.sums.start_s(mark)
        if mark:
            onset_s -= fraction * self.sums.seconds(mark - 1, mark)
        return Finding(
            fault,
            int(self.sums.mark_blocks[mark]),
            fraction,
            coefficient,
            deviation,
            statistic,
            0.0,
            onset_s,
            lasting,
        )


def _fault_as_nuisance(
    finding: Finding, mark: int, products: FaultProducts, ff: Array, fy: Array
) -> tuple[Array, Array, Array]:
    """Return products of nuisances of which a fault found is one more.

    Its prior is a hundred times what was found, which is as good as none.

    Returns:
        Its products with n nuisances (n + 1, n + 1), with missing flow (n + 1,), with faults
        (marks, 5, n + 1).
    """
    i, unit = finding.fault, 100.0 * finding.coefficient
    n = fy.size
    squares = np.empty((n + 1, n + 1))
    squares[:n, :n] = ff
    squares[n, :n] = squares[:n, n] = unit * products.crossed[mark, i]
    squares[n, n] = unit**2 * products.squares[mark, i, i]
    later = np.maximum(np.arange(products.blocks.size), mark)
    crossed = np.concatenate([products.crossed, unit * products.squares[later, :, i, None]], axis=2)
    return squares, np.append(fy, unit * products.products[mark, i]), crossed
