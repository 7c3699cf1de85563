"""From a filter's estimates to a verdict: the interface of detectors and the default detector."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from math import exp, hypot, isnan, sqrt
from typing import ClassVar, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import DEAD_ZONE, UNINFORMED, AccountBlock, NuisanceBelief, reference_flow
from estimator.encoder import DriftTest
from estimator.filters import FilterRun
from estimator.intermittent import ReturnTest
from estimator.learnt import LearntNoise
from rig.plant import FAULTS, LEAKS, LITRE_PER_MINUTE, Model, Parameters, signed_roots

from . import leak_verdicts
from .confirmation import Hold, PresentLeaks
from .decision import SILENT as SILENT, Decision as Decision, is_of as is_of
from .drift_watch import DriftWatch
from .finding import Finding
from .leak_statistic import MINIMUM_BLOCKS, LeakTest
from .learnt_test import LearntLeakTest
from .oil_account import OilAccount, Samples
from .supply_statistic import SupplyTest
from .travel import travel_needed

Array = NDArray[np.float64]

INCONCLUSIVE_ABOVE: Final = 0.5 * LITRE_PER_MINUTE
"""Flow in m^3/s at the reference drop. If a leak of this size would not have been found, the
verdict is inconclusive instead of healthy."""
LEAST_ACCOUNTED: Final = 0.5
"""Least part of the later half of the time that complete blocks must cover for a healthy verdict;
blocks are not complete where sensors are missing or a chamber is dry."""
GREATEST_LEAK: Final = 10.0 * LITRE_PER_MINUTE
"""Greatest flow in m^3/s that counts as a leak; a larger one means that a sensor is wrong (the
open valve passes 27 L/min, and the largest leak of figure 5.1 is 4 L/min)."""
FLOW_ERROR: Final = 0.25
"""Standard deviation of a leak's flow by errors of the model, as a part of the dead zone; the dead
zone bounds these errors, and a bound is taken for four standard deviations."""
SETTLED_AFTER_S: Final = 2.0
"""Seconds after a leak's onset from which its flow is averaged, as the command line documents."""


class Detector(Protocol):
    """The interface of a detector, which gets every sample once, in order, and makes decisions."""

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take the next samples with the filter's estimates of them."""

    def decide(self) -> Decision:
        """Return the decision that follows from all samples so far."""


class OilAccountDetector:
    """The default detector, which tests oil accounts made from the product filter's estimates.

    Its time per block and its memory do not grow with the length of the run.

    Args:
        model: the model that the filter assumes.
        false_alarms_per_day: alarms a healthy rig may raise in a day of running, above 0 to 10000.
        expected: what is known of this rig's nuisances, from a baseline.
        model_error: factor on what is allowed for errors of the model (dead zones and the like),
            0 to 10; 0 means that the model is exact.
        returning: whether leaks that come and go are looked for too.
        learnt: what was learnt of this rig's noise; the test for leaks that stay then allows for
            that instead of `model_error`, which the other tests keep.

    Raises:
        ValueError: the rate or the factor is outside its range.

    Attributes:
        claimed: the faults that stay which the last `decide` found, doubtful ones too; it may be
            empty.
        drawn_up: the blocks that the samples of the last `update` finished.
        begun: how often the test has started anew and dropped all earlier blocks.
        account: the oil account.
        leak_test, supply_test, drift_test: classes of the tests, which a derived class may replace.
    """

    leak_test: ClassVar[type[LeakTest]] = LeakTest
    supply_test: ClassVar[type[SupplyTest]] = SupplyTest
    drift_test: ClassVar[type[DriftTest]] = DriftTest

    def __init__(
        self,
        model: Model,
        false_alarms_per_day: float = 1.0,
        expected: NuisanceBelief = UNINFORMED,
        model_error: float = 1.0,
        *,
        returning: bool = True,
        learnt: LearntNoise | None = None,
    ) -> None:
        self._parameters = model.parameters
        self._setting = false_alarms_per_day, expected, model_error
        self._learnt = learnt
        self._test = self._new_test()
        self.account = OilAccount(model.parameters, self._test)
        self._supply = self.supply_test(model.parameters, false_alarms_per_day, model_error)
        self._returns = ReturnTest(model.parameters, *self._setting) if returning else None
        self._drift = DriftWatch(partial(self.drift_test, model.parameters, *self._setting))
        self._first_s = self._last_s = float("nan")
        self._alarm: Decision | None = None
        self._named: tuple[Finding, Decision] | None = None
        self._named_s = float("nan")
        self._hold = Hold()
        self._leaks = PresentLeaks(partial(leak_verdicts.present_coefficient, self._test))
        self.claimed: list[Finding] = []
        self.drawn_up: list[AccountBlock] = []
        self.begun = 0

    def _new_test(self) -> LeakTest:
        """Return a test for leaks that stay, without any block yet."""
        if self._learnt is None:
            return self.leak_test(*self._setting)
        rate, expected, _ = self._setting
        return LearntLeakTest(rate, expected, self._learnt, self._parameters)

    def _begin_anew(self) -> None:
        """Replace the leak test by a new one, without the blocks so far, and count this in `begun`.

        The test looks for faults that last, which blocks with a leak that has ended do not fit.
        """
        self.begun += 1
        self._test = self.account.test = self._new_test()
        self._leaks = PresentLeaks(partial(leak_verdicts.present_coefficient, self._test))
        self._named = None
        self._drift.begin_anew()

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Add the next samples, one or more, with the product filter's estimates of them.

        The blocks that they finish are tested, and stand in `drawn_up`. `decide` is to be called
        after each half second of samples, as its calls tell for how long a fault has been found.
        """
        self._advance(samples.time_s)
        self._drift.see(samples.position)
        for block in self.account.add(samples, run):
            self._add(block)

    def take(self, block: AccountBlock, time_s: Array, position: Array) -> None:
        """Add a block that was drawn up elsewhere, in place of `update` with the next samples.

        Args:
            block: the block, which ends with the last of the samples.
            time_s: time of each of the samples, s, (n,).
            position: what the encoder read in each of them, m, (n,); NaN where nothing.
        """
        self._advance(time_s)
        self._drift.see(position)
        self.account.take(block)
        self._add(block)

    def _advance(self, time_s: Array) -> None:
        if isnan(self._first_s):
            self._first_s = float(time_s[0])
        self._last_s = float(time_s[-1])
        self.drawn_up = []

    def _add(self, block: AccountBlock) -> None:
        self._supply.add(block)
        self._drift.add(block)
        if self._returns is not None:
            self._returns.add(block)
        self.drawn_up.append(block)

    @property
    def accuses(self) -> bool:
        """Return whether a fault stands out now, or a leak awaits its confirmation.

        A leak that comes and goes stands out from when its evidence is beyond the limit. One that
        awaits its confirmation was named by `decide` and is neither confirmed nor withdrawn yet.
        """
        found = bool(self._test.search()) or self._supply.search() is not None
        returns = self._returns is not None and self._returns.stands_out
        return found or returns or self._named is not None or self._drift.stands_out

    def evidence(self) -> tuple[float, float]:
        """Return the test statistic of one fault that stays, and the limit that it must exceed.

        The fault is that of `claimed` whose statistic exceeds its limit by the greatest factor; if
        none is claimed, the one that explains the accounts best, although it may be noise. The
        statistic exceeds the limit exactly if the last `decide` found a fault that stays. It is 0
        if no fault explains anything.
        """
        likeliest = self._test.likeliest() if not self.claimed else None
        found = self.claimed if likeliest is None else [likeliest]
        if not found:
            return 0.0, self._test.limit()
        most = max(found, key=lambda finding: finding.statistic / finding.limit)
        return max(most.statistic, 0.0), most.limit

    def model_errors(self) -> Array:
        """Return the estimates of `NUISANCES` in their order, in units of the tolerances: (n,)."""
        return self._test.nuisances().mean

    def decide(self) -> Decision:
        """Return the decision on all complete blocks so far; each call counts towards confirmation.

        A leak that comes and goes (`estimator.intermittent`) is named, and stays on record, unless
        a fault that stays explains the accounts better (`_with_returns`). An encoder that drifts is
        named where nothing else explains them as well (`DriftWatch`).
        """
        decision = self._with_returns(self._lasting())
        return self._drift.beside(decision, self._last_s, self.claimed)

    def _with_returns(self, lasting: Decision) -> Decision:
        """Return the decision on a leak that comes and goes, or that on faults that stay.

        A fault of another name is kept if its statistic, squared and halved, exceeds the evidence
        for the leak that comes and goes, both being gains in log likelihood.

        Args:
            lasting: the decision on faults that stay.
        """
        found = None if self._returns is None else self._returns.search()
        if found is None:
            return lasting
        other = lasting.names_a_fault and lasting.verdict != found.leak
        if other and 0.5 * lasting.statistic**2 > found.evidence:
            return lasting
        bound = FLOW_ERROR * self._test.model_error * DEAD_ZONE[LEAKS.index(found.leak)]
        flow = found.leak_m3_per_s
        return Decision(
            found.leak,
            found.onset_s,
            flow,
            hypot(
                found.leak_std_m3_per_s,
                bound * LITRE_PER_MINUTE,
                leak_verdicts.relative_error(self._test) * flow,
            ),
            found.coefficient,
            sqrt(2.0 * max(found.evidence, 0.0)),
            sqrt(2.0 * found.limit),
            lasting.details,
            _with_odds(
                lasting.probabilities,
                exp(min(found.average_gain, 100.0)) * leak_verdicts.PRIOR,
                found.leak,
            ),
            lasting.present_leaks,
            returns=found,
        )

    def _lasting(self) -> Decision:
        """Return the decision on faults that stay.

        A fault that has been found for 5 s is confirmed. When no fault is found later, the
        confirmed decision with the greatest statistic is repeated, even if its fault has ended. A
        leak that ends before it is confirmed counts as found while the blocks before its end still
        support it. Once all confirmed leaks have been gone for 5 s, the leak test starts anew.
        """
        if self._leaks.ended(self._last_s):
            self._begin_anew()
        dropped = self._supply.search()
        if dropped is None:
            findings, threshold = self._test.search(), self._test.limit()
        else:
            # A flow that a drop of the supply pressure explains is no leak.
            findings = leak_verdicts.leaks_beside(self._test, dropped)
            threshold = self._test.limit() if findings else self._supply.limit()
        accounts = self._probabilities()
        lines = leak_verdicts.may_be_lines(self._test, findings)
        present = self._leaks.update(self._last_s, [] if lines else findings, accounts)
        name = "multiple" if findings else "supply_leakage"
        probabilities = _with_odds(accounts, self._supply.odds(), name)
        if dropped is not None:
            findings = [*findings, dropped]
        self.claimed = findings
        if findings and (dropped is not None or not self._doubtful(findings, accounts)):
            decision = replace(
                self._found(findings, threshold, lines),
                probabilities=probabilities,
                present_leaks=present,
            )
            self._note(decision)
            self._name(findings, decision)
            return decision
        passed = self._passed()
        if passed is not None:
            self._note(passed)
        if self._alarm is not None:
            return replace(self._alarm, present_leaks=present)
        if passed is not None:
            return replace(passed, present_leaks=present)
        if findings:
            unnamed = self._found(findings, threshold, lines=True)
            return replace(unnamed, probabilities=probabilities)
        decision = replace(self._nothing_found(threshold), probabilities=probabilities)
        if probabilities.get("healthy", 1.0) < 0.5:
            # A fault is more likely than not, but a claim would exceed the stated false-alarm rate.
            return replace(decision, verdict="inconclusive")
        return decision

    def _note(self, decision: Decision) -> None:
        """Note that `decision` names a fault now; keep it as the alarm once that is confirmed.

        It replaces an earlier alarm whose statistic is not greater. Otherwise only the alarm's
        `ended_s` becomes that of `decision`, if both are of the same fault.
        """
        if not self._hold.found(self._last_s):
            return
        alarm = self._alarm
        if alarm is None or decision.statistic >= alarm.statistic:
            self._alarm = decision
        elif is_of(decision, alarm):
            self._alarm = replace(alarm, ended_s=decision.ended_s)

    def _name(self, findings: list[Finding], decision: Decision) -> None:
        """Remember the leak that `decision` names, in case it ends before it is confirmed.

        Only a leak that is named alone is remembered, with the decision in which its statistic was
        greatest. Once any fault is confirmed, none is. The time of the call is kept in any case.
        """
        leak, *others = findings
        self._named_s = self._last_s
        if self._alarm is not None:
            self._named = None
            return
        alone = not others and decision.verdict in LEAKS
        if alone and (self._named is None or leak.statistic >= self._named[0].statistic):
            self._named = leak, decision

    def _passed(self) -> Decision | None:
        """Return the decision on a leak that was named and ended unconfirmed; None without one.

        If there is one, `claimed` is set to it. A named leak of which no end is found is forgotten
        once no fault has been found for more than 5 s.
        """
        if self._named is None:
            return None
        leak, decision = self._named
        passed = leak_verdicts.passed_leak(self._test, leak, self._named_s)
        if passed is None:
            if self._hold.lapsed(self._last_s):
                self._named = None
            return None
        self.claimed = [passed]
        found = self._found([passed], passed.limit, lines=False)
        return replace(found, probabilities=decision.probabilities)

    def _doubtful(self, findings: list[Finding], probabilities: Mapping[str, float]) -> bool:
        """Return whether the first finding is not to be claimed under its name.

        That is so if its flow is above `GREATEST_LEAK`, or if it is the only finding, does not grow
        (the probabilities do not cover growth) and has a probability below one half.
        """
        first = findings[0]
        if first.fault < len(LEAKS) and first.coefficient * self._mean_size(first) > GREATEST_LEAK:
            return True
        alone = len(findings) == 1 and first.grown is None
        return alone and probabilities.get(FAULTS[first.fault], 1.0) < 0.5

    def _probabilities(self) -> dict[str, float]:
        """Return `Decision.probabilities` of the accounts; empty before `MINIMUM_BLOCKS` blocks."""
        if self._test.blocks < MINIMUM_BLOCKS:
            return {}
        names = ("healthy", *FAULTS, "multiple")
        return dict(
            zip(names, map(float, leak_verdicts.fault_probabilities(self._test)), strict=True)
        )

    def _found(self, findings: list[Finding], threshold: float, lines: bool) -> Decision:
        """Return the decision on findings, at least one, the first with the greatest gain.

        If `lines` is true, the verdict is `unknown_fault` and no leak is sized, as the findings may
        be a fault of the supply or return line. `threshold` is what the statistic had to exceed.
        """
        first, *others = findings
        details: dict[str, float] = {}
        if lines:
            verdict = "unknown_fault"
        elif others:
            verdict = "multiple"
            for finding in findings:
                name = FAULTS[finding.fault]
                details[f"{name}_coefficient"] = finding.coefficient
                details[f"{name}_onset_s"] = finding.onset_s
        else:
            verdict = self._called(first)
        decision = Decision(verdict, first.onset_s, statistic=first.statistic,
                            threshold=threshold, details=details)  # fmt: skip
        if lines or FAULTS[first.fault] not in LEAKS:
            return decision
        leaks = [finding for finding in findings if FAULTS[finding.fault] in LEAKS]
        sizes = [self._mean_size(leak) for leak in leaks]
        flow = sum(leak.coefficient * size for leak, size in zip(leaks, sizes, strict=True))
        deviations = [leak.deviation * size for leak, size in zip(leaks, sizes, strict=True)]
        bound = self._test.model_error * LITRE_PER_MINUTE
        deviations += [FLOW_ERROR * DEAD_ZONE[leak.fault] * bound for leak in leaks]
        deviations += [leak_verdicts.relative_error(self._test) * flow]
        return replace(
            decision,
            onset_s=min(finding.onset_s for finding in findings),
            leak_m3_per_s=flow,
            leak_std_m3_per_s=hypot(*deviations),
            coefficient=None if others else first.coefficient,
            ended_s=self._ended_s(leaks) if len(leaks) == len(findings) else None,
            growth=None
            if others
            else leak_verdicts.growth_of(
                self._test, first, sizes[0], FLOW_ERROR * DEAD_ZONE[first.fault] * bound
            ),
        )

    def _ended_s(self, leaks: list[Finding]) -> float | None:
        """Return when the last of the leaks ended, in s; None while any may be present."""
        ends = [leak.ended_s or leak_verdicts.end_of(self._test, leak) for leak in leaks]
        return None if None in ends else max(end for end in ends if end is not None)

    def _nothing_found(self, threshold: float) -> Decision:
        """Return a decision: healthy if the motion would have shown a leak, else inconclusive."""
        if self._test.blocks < MINIMUM_BLOCKS:
            return Decision("inconclusive", threshold=threshold)
        accounted, travel = self._later_half()
        details = {"travel_m": travel, "travel_needed_m": travel_needed(self._parameters)}
        for prefix, part in (("smallest", 0.5), ("smallest_from_start", 0.0)):
            coefficients = leak_verdicts.smallest_found(self._test, part)
            for leak, coefficient in zip(LEAKS, coefficients, strict=False):
                flow = reference_flow(self._parameters, leak, float(coefficient))
                details[f"{prefix}_{leak}_m3_per_s"] = flow
        unseen = max(details[f"smallest_{leak}_m3_per_s"] for leak in LEAKS) > INCONCLUSIVE_ABOVE
        still = travel < details["travel_needed_m"]
        blind = accounted < LEAST_ACCOUNTED
        details["accounted"] = accounted
        verdict = "inconclusive" if unseen or still or blind else "healthy"
        return Decision(verdict, threshold=threshold, details=details)

    def _later_half(self) -> tuple[float, float]:
        """Return what part of the later half of the time complete blocks cover, and its travel (m).

        The travel is the ram's greatest less its least position in these blocks.
        """
        sums, half_s = self._test.sums, 0.5 * (self._last_s - self._first_s)
        mark = sums.mark_at(self._first_s + half_s)
        if mark == sums.marks:
            return 0.0, 0.0
        return sums.seconds(mark) / half_s, sums.travel(mark)

    def _mean_size(self, finding: Finding) -> float:
        """Return the mean absolute flow in m^3/s that a leak has per unit coefficient.

        It is averaged from 2 s after the leak's onset up to its end or up to now; if no block lies
        between, from the onset.
        """
        sums = self._test.sums
        mark, last = sums.mark_at(finding.onset_s + SETTLED_AFTER_S), sums.marks
        if finding.ended_s is not None:
            last = sums.mark_at(finding.ended_s)
        if mark >= last:
            mark = sums.mark_of(finding.onset)
        return float(sums.mean_sizes(mark, last)[finding.fault]) * LITRE_PER_MINUTE

    def _called(self, finding: Finding) -> str:
        """Return the verdict on a single fault: its name, or `unknown_fault`.

        A leak of the actuator always keeps its name. Supply leakage needs a drop of the measured
        supply pressure, and a return blockage a measured supply pressure that has not dropped.
        """
        name = FAULTS[finding.fault]
        if name in LEAKS or finding == self._supply.search():
            return name
        sums = self._test.sums
        onset = sums.mark_of(finding.onset)
        count, before, spread = sums.supply(0, onset)
        _, after, _ = sums.supply(onset)
        # Where the supply pressure is measured, only its own test may name a supply leakage.
        if isnan(before) or isnan(after) or name == "supply_leakage":
            return "unknown_fault"
        dropped, wander = before - after, spread / sqrt(count)
        return name if dropped <= max(3.0 * wander, 1e5) else "unknown_fault"


def _with_odds(probabilities: Mapping[str, float], odds: float, name: str) -> dict[str, float]:
    """Return the accounts' probabilities with those of another test's finding added.

    Its probability, by its `odds`, is added to that of `name`; what the accounts say shrinks to the
    rest. The finding may be a drop of the supply pressure, or a leak that comes and goes.
    """
    share = odds / (1.0 + odds)
    return {
        each: (1.0 - share) * value + (share if each == name else 0.0)
        for each, value in probabilities.items()
    }


def leak_flow(run: FilterRun, parameters: Parameters) -> dict[str, Array]:
    """Return the product filter's signed leak flows by name in `LEAKS`: (n,), m^3/s (eq. 5.2)."""
    p1, p2 = run.state("pressure_1_Pa"), run.state("pressure_2_Pa")
    drops = (p1 - parameters.return_pressure, p2 - parameters.return_pressure, p1 - p2)
    return {
        leak: run.state(f"{leak}_m3_per_s_sqrtPa") * signed_roots(drop)
        for leak, drop in zip(LEAKS, drops, strict=True)
    }
