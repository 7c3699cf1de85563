"""From a filter's estimates to a verdict: what a detector is, and the product's own."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import hypot, isnan, sqrt
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    DEAD_ZONE,
    UNINFORMED,
    AccountBlock,
    NuisanceBelief,
    reference_drop,
    reference_flow,
)
from estimator.filters import FilterRun
from rig.plant import (
    FAULTS,
    LEAKS,
    LITRE_PER_MINUTE,
    Model,
    Parameters,
    chamber_volumes,
    signed_roots,
)

from .confirmation import Hold, PresentLeaks
from .finding import Finding
from .leak_statistic import MINIMUM_BLOCKS, LeakTest
from .leak_verdicts import LeakVerdicts
from .oil_account import OilAccount
from .supply_statistic import SupplyTest

Array = NDArray[np.float64]

SILENT: Final = ("healthy", "inconclusive")
"""Verdicts that name no fault."""
INCONCLUSIVE_ABOVE: Final = 0.5 * LITRE_PER_MINUTE
"""If even a leak of this flow (m^3/s, at its reference drop) would have stayed unseen, say so."""
LEAST_ACCOUNTED: Final = 0.5
"""With less of the later half accounted for (sensors missing, chamber dry), nothing is claimed."""
GREATEST_LEAK: Final = 10.0 * LITRE_PER_MINUTE
"""m^3/s: what would be a greater leak is a sensor that errs (the valve passes 27 L/min, figure 5.1
has leaks of up to 4)."""
SIZE_ERROR: Final = 0.02
"""Part of a leak's flow that it may be off by, one standard deviation: the tolerance of a metering
edge (`NUISANCES`), by which the accounts measure it."""
FLOW_ERROR: Final = 0.25
"""Part of the dead zone that a flow may be off by, one standard deviation: a bound is taken for
four of them."""
SETTLED_AFTER_S: Final = 2.0
"""A leak's flow is averaged from this long after its onset (the command-line contract)."""


@dataclass(frozen=True)
class Samples:
    """A stretch of a recording as a detector sees it: float64 (n,) each, SI; NaN: not measured."""

    time_s: Array
    command: Array
    position: Array
    pressure_1: Array
    pressure_2: Array
    spool: Array
    supply_pressure: Array


@dataclass(frozen=True)
class Decision:
    """What a detector holds after the samples it has seen.

    Attributes:
        verdict: one of the names in `faults.verdict`.
        onset_s: estimated start of the fault; None when healthy or inconclusive.
        leak_m3_per_s: mean absolute leak flow from 2 s after onset, of all leaks found together.
        leak_std_m3_per_s: its standard error, model error included.
        coefficient: leak coefficient, m^3/(s Pa^0.5); None if there are several faults.
        statistic, threshold: the test statistic and what a healthy rig exceeds at the stated rate.
        details: further figures by name, for reports.
        probabilities: of `healthy`, each of `FAULTS` alone and `multiple`, adding up to 1; empty
            while nothing can be said.
        present_leaks: coefficients of the leaks (`LEAKS`) confirmed to be there now,
            m^3/(s Pa^0.5); 0 where there is none, or none any more.
        ended_s: when the fault was gone again, to half a second or so; None while it may be there.
    """

    verdict: str
    onset_s: float | None = None
    leak_m3_per_s: float | None = None
    leak_std_m3_per_s: float | None = None
    coefficient: float | None = None
    statistic: float = 0.0
    threshold: float = float("inf")
    details: Mapping[str, float] = field(default_factory=dict)
    probabilities: Mapping[str, float] = field(default_factory=dict)
    present_leaks: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ended_s: float | None = None

    @property
    def names_a_fault(self) -> bool:
        """Whether the verdict is a fault."""
        return self.verdict not in SILENT

    @property
    def suspected(self) -> str | None:
        """The likeliest fault where the verdict is inconclusive and health is less likely than not.

        It is not claimed, as that would raise more false alarms than stated.
        """
        if self.verdict != "inconclusive" or self.probabilities.get("healthy", 1.0) >= 0.5:
            return None
        faults = {name: share for name, share in self.probabilities.items() if name != "healthy"}
        return max(faults, key=lambda name: faults[name])

    @property
    def interval_m3_per_s(self) -> tuple[float, float] | None:
        """95 % interval of the leak flow."""
        if self.leak_m3_per_s is None or self.leak_std_m3_per_s is None:
            return None
        half = 1.96 * self.leak_std_m3_per_s
        return max(self.leak_m3_per_s - half, 0.0), self.leak_m3_per_s + half


class Detector(Protocol):
    """Anything that turns estimates into decisions; it sees every sample once, in order."""

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take the next stretch of samples with the filter's estimates of them."""

    def decide(self) -> Decision:
        """Return the decision that the samples seen so far support."""


_ESTIMATES: Final = ("spool_m", "pressure_1_Pa", "pressure_2_Pa", "position_m")


_FROZEN_SAMPLES: Final = 40
"""A pressure that reads the very same for so many samples is not measured any more: noise of 30 kPa
would not let it. A rule of its own: these samples are only left out, whatever rig they come from;
the loop, which trips, derives its count from the chance of a false trip at its rate
(`rig.loop.interlocks.check_tolerances.frozen_samples`)."""


def _alive(values: Array) -> NDArray[np.bool_]:
    """Return which samples are not of a stretch of `_FROZEN_SAMPLES` like ones."""
    starts = np.flatnonzero(np.concatenate([[True], np.diff(values) != 0.0]))
    lengths = np.diff([*starts, values.size])
    return np.repeat(lengths < _FROZEN_SAMPLES, lengths)


def draw_up(account: OilAccount, samples: Samples, run: FilterRun) -> Iterator[AccountBlock]:
    """Add samples with the product filter's estimates; yield each block when it is tested."""
    fresh = np.isfinite(samples.position + samples.pressure_1 + samples.pressure_2)
    fresh &= _alive(samples.pressure_1) & _alive(samples.pressure_2)
    spool, p1, p2, position = (run.state(name) for name in _ESTIMATES)
    return account.add(
        run.time_s, spool, p1, p2, position, fresh.astype(np.float64), samples.supply_pressure
    )


class OilAccountDetector:
    """The default detector: tests the oil accounts kept with the product filter's estimates.

    Its time per block and its memory do not grow with the length of the run.

    Args:
        model: the model the filter assumes.
        false_alarms_per_day: alarms a healthy rig may raise in a day of continuous running.
        expected: what is known of this rig's nuisances, from a baseline.
        model_error: factor on what is allowed for errors of the model (dead zones and the like);
            0: the model is exact.

    Attributes:
        drawn_up: the accounts that the last samples completed.
        begun: how often accounts were begun anew, those before being left behind.
    """

    def __init__(
        self,
        model: Model,
        false_alarms_per_day: float = 1.0,
        expected: NuisanceBelief = UNINFORMED,
        model_error: float = 1.0,
    ) -> None:
        self._parameters = model.parameters
        self._setting = false_alarms_per_day, expected, model_error
        self._test = LeakTest(*self._setting)
        self._verdicts = LeakVerdicts(self._test)
        self._account = OilAccount(model.parameters, self._test)
        self._supply = SupplyTest(model.parameters, false_alarms_per_day, model_error)
        self._first_s = self._last_s = float("nan")
        self._alarm: Decision | None = None
        self._named: tuple[Finding, Decision] | None = None
        self._named_s = float("nan")
        self._hold = Hold()
        self._leaks = PresentLeaks(self._verdicts)
        self._claimed: list[Finding] = []
        self.drawn_up: list[AccountBlock] = []
        self.begun = 0

    def _begin_anew(self) -> None:
        """Leave the blocks so far behind: a leak that came and went fits no fault that stays."""
        self.begun += 1
        self._test = self._account.test = LeakTest(*self._setting)
        self._verdicts = LeakVerdicts(self._test)
        self._leaks = PresentLeaks(self._verdicts)
        self._named = None

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Add samples to the accounts (any number; a decision is due at the end of each block)."""
        if isnan(self._first_s):
            self._first_s = float(samples.time_s[0])
        self._last_s = float(samples.time_s[-1])
        self.drawn_up = []
        for block in draw_up(self._account, samples, run):
            self._supply.add(block)
            self.drawn_up.append(block)

    @property
    def accuses(self) -> bool:
        """Whether a fault stands out, or did a moment ago; cheaper than a decision."""
        found = bool(self._test.search()) or self._supply.search() is not None
        return found or self._named is not None

    @property
    def claimed(self) -> Sequence[Finding]:
        """Return the faults that the last decision found; none if it only keeps an earlier one."""
        return self._claimed

    def evidence(self) -> tuple[float, float]:
        """Return the statistic of what speaks most for a fault, and what it has to exceed.

        It does so just where the last decision found a fault.
        """
        likeliest = self._test.likeliest() if not self._claimed else None
        found = [*self._claimed] if likeliest is None else [likeliest]
        if not found:
            return 0.0, self._test.limit()
        most = max(found, key=lambda finding: finding.statistic / finding.limit)
        return max(most.statistic, 0.0), most.limit

    def model_errors(self) -> Array:
        """Return what the accounts say of the model's nuisances, in their tolerances: (n,)."""
        return self._test.nuisances().mean

    def decide(self) -> Decision:
        """Return the verdict of the sequential test on all complete blocks so far.

        An alarm that has been held for 5 s is confirmed, and stays: a fault that has gone again is
        still reported, as it stood out most. It counts as held while what went before its end still
        speaks for it.
        """
        if self._leaks.ended(self._last_s):
            self._begin_anew()
        dropped = self._supply.search()
        # What a drop of the supply pressure explains is no leak.
        findings = self._test.search() if dropped is None else self._verdicts.leaks_beside(dropped)
        threshold = self._test.limit() if dropped is None or findings else self._supply.limit()
        accounts = self._probabilities()
        lines = self._verdicts.may_be_lines(findings)
        present = self._leaks.update(self._last_s, [] if lines else findings, accounts)
        probabilities = _with_supply(accounts, self._supply.odds(), bool(findings))
        if dropped is not None:
            findings = [*findings, dropped]
        self._claimed = findings
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
            first = findings[0]
            return Decision("unknown_fault", first.onset_s, statistic=first.statistic,
                            threshold=threshold, probabilities=probabilities)  # fmt: skip
        decision = replace(self._nothing_found(threshold), probabilities=probabilities)
        if probabilities.get("healthy", 1.0) < 0.5:
            # More likely than not there is something, though not at the stated false-alarm rate.
            return replace(decision, verdict="inconclusive")
        return decision

    def _note(self, decision: Decision) -> None:
        """Keep an alarm that is confirmed, as it stood out most, and when its fault ended."""
        if not self._hold.found(self._last_s):
            return
        alarm = self._alarm
        if alarm is None or decision.statistic >= alarm.statistic:
            self._alarm = decision
        elif is_of(decision, alarm):
            self._alarm = replace(alarm, ended_s=decision.ended_s)

    def _name(self, findings: list[Finding], decision: Decision) -> None:
        """Keep a leak that is named, as it stood out most: it may go before it is confirmed."""
        leak, *others = findings
        self._named_s = self._last_s
        if self._alarm is not None:
            self._named = None
            return
        alone = not others and decision.verdict in LEAKS
        if alone and (self._named is None or leak.statistic >= self._named[0].statistic):
            self._named = leak, decision

    def _passed(self) -> Decision | None:
        """Return the decision on a leak that was named and went before it was confirmed."""
        if self._named is None:
            return None
        leak, decision = self._named
        passed = self._verdicts.passed(leak, self._named_s)
        if passed is None:
            if self._hold.lapsed(self._last_s):
                self._named = None
            return None
        self._claimed = [passed]
        found = self._found([passed], passed.limit, lines=False)
        return replace(found, probabilities=decision.probabilities)

    def _doubtful(self, findings: list[Finding], probabilities: Mapping[str, float]) -> bool:
        """Return whether a fault that stands out is likelier to be another one, or none known.

        A leak that grows is not in the probabilities, and one above `GREATEST_LEAK` is no leak.
        """
        first = findings[0]
        if first.fault < len(LEAKS) and first.coefficient * self._mean_size(first) > GREATEST_LEAK:
            return True
        alone = len(findings) == 1 and first.grown is None
        return alone and probabilities.get(FAULTS[first.fault], 1.0) < 0.5

    def _probabilities(self) -> dict[str, float]:
        """Return the probabilities of no fault and of each; none before anybody is accused."""
        if self._test.blocks < MINIMUM_BLOCKS:
            return {}
        names = ("healthy", *FAULTS, "multiple")
        return dict(zip(names, map(float, self._verdicts.probabilities()), strict=True))

    def _found(self, findings: list[Finding], threshold: float, lines: bool) -> Decision:
        first = findings[0]
        details: dict[str, float] = {}
        if lines:
            return Decision("unknown_fault", first.onset_s, statistic=first.statistic,
                            threshold=threshold)  # fmt: skip
        if len(findings) > 1:
            for finding in findings:
                name = FAULTS[finding.fault]
                details[f"{name}_coefficient"] = finding.coefficient
                details[f"{name}_onset_s"] = finding.onset_s
        verdict = "multiple" if len(findings) > 1 else self._called(first)
        if FAULTS[first.fault] not in LEAKS:
            return Decision(verdict, first.onset_s, statistic=first.statistic,
                            threshold=threshold, details=details)  # fmt: skip
        leaks = [finding for finding in findings if FAULTS[finding.fault] in LEAKS]
        sizes = [self._mean_size(leak) for leak in leaks]
        flow = sum(leak.coefficient * size for leak, size in zip(leaks, sizes, strict=True))
        deviations = [leak.deviation * size for leak, size in zip(leaks, sizes, strict=True)]
        bound = self._test.model_error * LITRE_PER_MINUTE
        deviations += [FLOW_ERROR * DEAD_ZONE[leak.fault] * bound for leak in leaks]
        deviations += [SIZE_ERROR * flow]
        return Decision(
            verdict,
            min(finding.onset_s for finding in findings),
            flow,
            hypot(*deviations),
            first.coefficient if len(findings) == 1 else None,
            first.statistic,
            threshold,
            details,
            ended_s=self._ended_s(leaks) if len(leaks) == len(findings) else None,
        )

    def _ended_s(self, leaks: list[Finding]) -> float | None:
        """Return when the last of some leaks had gone; None while any may be there."""
        ends = [leak.ended_s or self._verdicts.ended_s(leak) for leak in leaks]
        return None if None in ends else max(end for end in ends if end is not None)

    def _nothing_found(self, threshold: float) -> Decision:
        """Healthy only if the motion would have shown a leak, else inconclusive."""
        if self._test.blocks < MINIMUM_BLOCKS:
            return Decision("inconclusive", threshold=threshold)
        accounted, travel = self._later_half()
        details = {"travel_m": travel, "travel_needed_m": self._travel_needed()}
        for prefix, part in (("smallest", 0.5), ("smallest_from_start", 0.0)):
            coefficients = self._verdicts.smallest(part)
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
        """Return the accounted part of the later half of what was seen, and its travel in m."""
        sums, half_s = self._test.sums, 0.5 * (self._last_s - self._first_s)
        mark = sums.mark_at(self._first_s + half_s)
        if mark == sums.marks:
            return 0.0, 0.0
        return sums.seconds(mark) / half_s, sums.travel(mark)

    def _travel_needed(self) -> float:
        """Travel in m that sweeps the oil a chamber stores by compression at half supply pressure.

        A ram that stands still lets a leak run its chamber dry and then shows nothing.
        """
        par = self._parameters
        volume = chamber_volumes(0.5 * (par.stroke_min + par.stroke_max), par)[0]
        stored = volume / par.bulk_modulus * reference_drop(par, "external_leakage_1")
        return float(stored / par.piston_area)

    def _mean_size(self, finding: Finding) -> float:
        """Mean absolute flow per unit coefficient from 2 s after onset (or all there is since)."""
        sums = self._test.sums
        mark, last = sums.mark_at(finding.onset_s + SETTLED_AFTER_S), sums.marks
        if finding.ended_s is not None:
            last = sums.mark_at(finding.ended_s)
        if mark >= last:
            mark = sums.mark_of(finding.onset)
        return float(sums.mean_sizes(mark, last)[finding.fault]) * LITRE_PER_MINUTE

    def _called(self, finding: Finding) -> str:
        """Name a fault; those of the supply and return lines need a measured supply pressure."""
        name = FAULTS[finding.fault]
        if name in LEAKS or finding == self._supply.search():
            return name
        sums = self._test.sums
        onset = sums.mark_of(finding.onset)
        count, before, spread = sums.supply(0, onset)
        _, after, _ = sums.supply(onset)
        # A supply that is measured is judged by its own test, not by what the valve lets through.
        if isnan(before) or isnan(after) or name == "supply_leakage":
            return "unknown_fault"
        dropped, wander = before - after, spread / sqrt(count)
        return name if dropped <= max(3.0 * wander, 1e5) else "unknown_fault"


def is_of(decision: Decision, earlier: Decision) -> bool:
    """Tell whether a decision is on the fault that an earlier one named, and not on its return."""
    if decision.verdict != earlier.verdict:
        return False
    began, ended = decision.onset_s, earlier.ended_s
    return began is None or ended is None or began < ended


def _with_supply(
    probabilities: Mapping[str, float], odds: float, leaking: bool
) -> dict[str, float]:
    """Return the accounts' probabilities with the odds that the supply pressure dropped."""
    share = odds / (1.0 + odds)
    name = "multiple" if leaking else "supply_leakage"
    return {
        each: (1.0 - share) * value + (share if each == name else 0.0)
        for each, value in probabilities.items()
    }


def leak_flow(run: FilterRun, parameters: Parameters) -> dict[str, Array]:
    """Return the product filter's leak flows, float64 (n,) in m^3/s each, by leak (eq. 5.2)."""
    p1, p2 = run.state("pressure_1_Pa"), run.state("pressure_2_Pa")
    drops = (p1 - parameters.return_pressure, p2 - parameters.return_pressure, p1 - p2)
    return {
        leak: run.state(f"{leak}_m3_per_s_sqrtPa") * signed_roots(drop)
        for leak, drop in zip(LEAKS, drops, strict=True)
    }
