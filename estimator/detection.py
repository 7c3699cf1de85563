"""From a filter's estimates to a verdict: what a detector is, and the product's own."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import hypot, sqrt
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from rig.plant import Model, Parameters
from rig.plant.dynamics import chamber_volumes, signed_root
from rig.plant.parameters import LITRE_PER_MINUTE

from .filters import FilterRun
from .flow_account import (
    FAULTS,
    AccountBlock,
    FlowAccount,
    reference_drop,
    reference_flow,
)
from .leak_test import MINIMUM_BLOCKS, UNINFORMED, Finding, LeakTest, NuisanceBelief

Array = NDArray[np.float64]

LEAKS: Final = FAULTS[:3]
INCONCLUSIVE_ABOVE: Final = 0.5 * LITRE_PER_MINUTE
"""If even a leak of this flow (m^3/s, at its reference drop) would have stayed unseen, say so."""
LEAST_ACCOUNTED: Final = 0.5
"""With less of the later half accounted for (sensors missing, chamber dry), nothing is claimed."""
CONFIRMED_AFTER_S: Final = 5.0
"""An alarm is withdrawn if what raised it passes before that."""
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
        leak_std_m3_per_s: its standard error, model-error budget included.
        coefficient: leak coefficient, m^3/(s Pa^0.5); None if there are several faults.
        statistic, threshold: the test statistic and what a healthy rig exceeds at the stated rate.
        details: further figures by name, for reports.
    """

    verdict: str
    onset_s: float | None = None
    leak_m3_per_s: float | None = None
    leak_std_m3_per_s: float | None = None
    coefficient: float | None = None
    statistic: float = 0.0
    threshold: float = float("inf")
    details: Mapping[str, float] = field(default_factory=dict)

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


def draw_up(account: FlowAccount, samples: Samples, run: FilterRun) -> list[AccountBlock]:
    """Add samples with the product filter's estimates to an account; return the blocks finished."""
    fresh = np.isfinite(samples.position + samples.pressure_1 + samples.pressure_2)
    return account.add(
        run.time_s,
        run.state("spool_m"),
        run.state("null_bias_m"),
        run.state("pressure_1_Pa"),
        run.state("pressure_2_Pa"),
        run.state("position_m"),
        fresh.astype(np.float64),
    )


class OilAccountDetector:
    """The default detector: tests the oil accounts kept with the product filter's estimates.

    Args:
        model: the model the filter assumes.
        false_alarms_per_day: alarms a healthy rig may raise in a day of continuous running.
        expected: what is known of this rig's nuisances, from a baseline.
    """

    def __init__(
        self,
        model: Model,
        false_alarms_per_day: float = 1.0,
        expected: NuisanceBelief = UNINFORMED,
    ) -> None:
        self._parameters = model.parameters
        self._account = FlowAccount(model.parameters)
        self._test = LeakTest(false_alarms_per_day, expected)
        self._blocks: list[AccountBlock] = []
        self._tested: list[int] = []
        self._supply: list[float] = []
        self._ranges: list[tuple[float, float]] = []
        self._supply_sum = np.zeros(2)
        self._first_s = self._last_s = 0.0
        self._alarm: Decision | None = None
        self._held_since: float | None = None

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Add samples to the accounts (any number; a decision is due at the end of each block)."""
        position = run.state("position_m")
        blocks = draw_up(self._account, samples, run)
        if not self._ranges:
            self._first_s = float(samples.time_s[0])
        self._last_s = float(samples.time_s[-1])
        self._ranges.append((float(position.min()), float(position.max())))
        measured = samples.supply_pressure[np.isfinite(samples.supply_pressure)]
        self._supply_sum += (measured.sum(), measured.size)
        for block in blocks:
            if block.complete:
                self._tested.append(len(self._blocks))
                self._test.add(block)
            self._blocks.append(block)
            total, count = self._supply_sum
            self._supply.append(total / count if count else np.nan)
            self._supply_sum[:] = 0.0

    def decide(self) -> Decision:
        """Return the verdict of the sequential test on all complete blocks so far.

        An alarm that has been held for 5 s stays: a fault that has gone again is still reported, as
        it stood out most.
        """
        findings = self._test.search()
        threshold = self._test.threshold(10.0 + 2.0 * self._test.blocks)
        if not findings:
            self._held_since = None
            return self._alarm or self._nothing_found(threshold)
        decision = self._found(findings, threshold)
        if self._held_since is None:
            self._held_since = self._last_s
        if self._last_s - self._held_since >= CONFIRMED_AFTER_S and (
            self._alarm is None or decision.statistic >= self._alarm.statistic
        ):
            self._alarm = decision
        return decision

    def _found(self, findings: list[Finding], threshold: float) -> Decision:
        first = findings[0]
        details: dict[str, float] = {}
        if len(findings) > 1:
            for finding in findings:
                name = FAULTS[finding.fault]
                details[f"{name}_coefficient"] = finding.coefficient
                details[f"{name}_onset_s"] = self._onset(finding)
        verdict = "multiple" if len(findings) > 1 else self._name(first)
        if FAULTS[first.fault] not in LEAKS:
            return Decision(verdict, self._onset(first), statistic=first.statistic,
                            threshold=threshold, details=details)  # fmt: skip
        leaks = [finding for finding in findings if FAULTS[finding.fault] in LEAKS]
        sizes = [self._mean_size(leak) for leak in leaks]
        flow = sum(leak.coefficient * size for leak, size in zip(leaks, sizes, strict=True))
        deviations = (leak.deviation * size for leak, size in zip(leaks, sizes, strict=True))
        return Decision(
            verdict,
            min(self._onset(finding) for finding in findings),
            flow,
            hypot(*deviations),
            first.coefficient if len(findings) == 1 else None,
            first.statistic,
            threshold,
            details,
        )

    def _nothing_found(self, threshold: float) -> Decision:
        """Healthy only if the motion would have shown a leak, else inconclusive."""
        if self._test.blocks < MINIMUM_BLOCKS:
            return Decision("inconclusive", threshold=threshold)
        details = {"travel_m": self._travel(), "travel_needed_m": self._travel_needed()}
        for prefix, part in (("smallest", 0.5), ("smallest_from_start", 0.0)):
            coefficients = self._test.smallest(part)
            for leak, coefficient in zip(LEAKS, coefficients, strict=False):
                flow = reference_flow(self._parameters, leak, float(coefficient))
                details[f"{prefix}_{leak}_m3_per_s"] = flow
        unseen = max(details[f"smallest_{leak}_m3_per_s"] for leak in LEAKS) > INCONCLUSIVE_ABOVE
        still = details["travel_m"] < details["travel_needed_m"]
        details["accounted"] = self._accounted()
        blind = details["accounted"] < LEAST_ACCOUNTED
        verdict = "inconclusive" if unseen or still or blind else "healthy"
        return Decision(verdict, threshold=threshold, details=details)

    def _accounted(self) -> float:
        """Part of the later half of what was seen for which the oil could be accounted for."""
        half = 0.5 * (self._first_s + self._last_s)
        accounted = sum(
            b.end_s - max(b.start_s, half) for b in self._blocks if b.complete and b.end_s > half
        )
        return float(accounted / (self._last_s - half))

    def _travel(self) -> float:
        """Range of the ram's position in m over the later half of what was seen."""
        later = np.array(self._ranges[len(self._ranges) // 2 :])
        return float(later[:, 1].max() - later[:, 0].min())

    def _travel_needed(self) -> float:
        """Travel in m that sweeps the oil a chamber stores by compression at half supply pressure.

        A ram that stands still lets a leak run its chamber dry and then shows nothing.
        """
        par = self._parameters
        volume = chamber_volumes(0.5 * (par.stroke_min + par.stroke_max), par)[0]
        stored = volume / par.bulk_modulus * reference_drop(par, "external_leakage_1")
        return float(stored / par.piston_area)

    def _onset(self, finding: Finding) -> float:
        start = self._blocks[self._tested[finding.onset]].start_s
        if finding.onset == 0:
            return start
        before = self._blocks[self._tested[finding.onset - 1]]
        return start - finding.onset_fraction * (before.end_s - before.start_s)

    def _mean_size(self, finding: Finding) -> float:
        """Mean absolute flow per unit coefficient from 2 s after onset (or all there is since)."""
        first = self._tested[finding.onset]
        settled = self._onset(finding) + SETTLED_AFTER_S
        since = [b for b in self._blocks[first:] if b.start_s >= settled - 1e-6]
        chosen = since or self._blocks[first:]
        sizes = [block.sizes[finding.fault] for block in chosen]
        return float(np.average(sizes, weights=[block.end_s - block.start_s for block in chosen]))

    def _name(self, finding: Finding) -> str:
        """Name a fault; those of the supply and return lines need a measured supply pressure."""
        name = FAULTS[finding.fault]
        if name in LEAKS:
            return name
        onset = self._tested[finding.onset]
        before, after = np.array(self._supply[:onset]), np.array(self._supply[onset:])
        if not np.isfinite(before).any() or not np.isfinite(after).any():
            return "unknown_fault"
        dropped = np.nanmean(before) - np.nanmean(after)
        wander = np.nanstd(before) / sqrt(max(np.isfinite(before).sum(), 1))
        if name == "supply_leakage":
            return name if dropped > 3.0 * wander else "unknown_fault"
        return name if dropped <= max(3.0 * wander, 1e5) else "unknown_fault"


def leak_flow(run: FilterRun, parameters: Parameters) -> dict[str, Array]:
    """Return the product filter's leak flows, float64 (n,) in m^3/s each, by leak (eq. 5.2)."""
    p1, p2 = run.state("pressure_1_Pa"), run.state("pressure_2_Pa")
    drops = (p1 - parameters.return_pressure, p2 - parameters.return_pressure, p1 - p2)
    root = np.vectorize(signed_root)
    return {
        leak: run.state(f"{leak}_m3_per_s_sqrtPa") * root(drop)
        for leak, drop in zip(LEAKS, drops, strict=True)
    }
