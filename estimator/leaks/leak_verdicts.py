"""What the accounts of a leak test say beside what it finds.

How probable each fault is, whether leaks may be a fault of the lines, what is left of a leak, and
the smallest one that would have been found.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import log, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    FAULT_COUNT,
    INTERNAL_LEAKAGE,
    SHIFT,
    SUPPLY_LEAKAGE,
    JointFit,
    around,
)

from .finding import Finding
from .leak_statistic import MINIMUM_BLOCKS, RIVAL_GAIN, LeakTest

Array = NDArray[np.float64]

PRIOR: Final = 0.01
"""Probability before any data, of each fault, that a run has it."""
GREATEST_FLOW: Final = 4.0
"""L/min: before any data a fault's flow may be anything up to this (figure 5.1: bypass lines)."""


class LeakVerdicts:
    """Answers questions about the blocks that a leak test has taken, beside what it finds.

    Args:
        test: all findings are its own.
    """

    def __init__(self, test: LeakTest) -> None:
        self._test = test

    def leaks_beside(self, dropped: Finding) -> list[Finding]:
        """Return the leak that stands out beside a measured drop of the supply pressure, if any."""
        test = self._test
        if test.blocks < MINIMUM_BLOCKS:
            return []
        mark = min(test.sums.mark_at(dropped.onset_s), test.sums.marks - 1)
        leak = test.best(replace(dropped, onset=int(test.sums.mark_blocks[mark])))
        return [] if leak is None or leak.fault >= SUPPLY_LEAKAGE else [leak]

    def may_be_lines(self, findings: Sequence[Finding]) -> bool:
        """Tell whether leaks found may be a fault of the supply or return line.

        Where the supply pressure is not measured, such a fault moves both accounts, as an internal
        leak does or two leaks. It is told by what it explains beside the first leak: next to
        nothing where that is the cause, and as much as a second leak where the lines are.
        """
        if not findings or self._test.sums.supply(0)[0]:
            return False
        if any(finding.fault >= SUPPLY_LEAKAGE for finding in findings):
            return True
        first, *others = findings
        if not others and first.fault != INTERNAL_LEAKAGE:
            return False
        beside = self._test.candidates(first).gain
        line = float(beside[:, SUPPLY_LEAKAGE:].max())
        second = max((float(beside[:, other.fault].max()) for other in others), default=0.0)
        return line >= (second - RIVAL_GAIN if others else RIVAL_GAIN)

    def smallest(self, part: float = 0.5) -> Array:
        """Return the smallest coefficient of each fault (5,), SI, that would have been found.

        Args:
            part: part of the blocks after which the fault would have begun.
        """
        test = self._test
        candidates = test.candidates()
        regression = candidates.regression
        mark = min(test.sums.mark_of(int(part * test.blocks)), test.sums.marks - 1)
        information = candidates.scores.information[mark]
        size = candidates.products.sizes[mark]
        visible = (information > 0.0) & (size > 0.0)
        lasting = test.healthy_noise()
        error = regression.variance * lasting / np.where(visible, information, 1.0)
        dead = test.dead_zone / np.where(visible, size, 1.0)
        return np.where(visible, test.limit() * np.sqrt(error) + dead, np.inf)

    def present(self, finding: Finding) -> float:
        """Return a fault's coefficient as it is now, SI: another one if it has changed since.

        0 if it has gone: what is left is within the dead zone, the part of what there was that the
        leak law may be wrong by, or two standard errors.
        """
        test = self._test
        if finding.grown is not None:
            return finding.grown
        candidates = test.candidates(finding)
        first, fault = test.mark(finding), finding.fault
        mark = int(np.argmax(candidates.change))
        if candidates.change[mark] < test.limit() ** 2:
            return finding.coefficient
        variance = float(candidates.scores.variance[mark, fault])
        faults, marks = [SHIFT, fault, fault], [mark, first, mark]
        straddling = around(marks, test.sums.marks)
        if len(straddling) == 1:
            # It changed so soon that no block is left which it was there throughout.
            straddling = []
        fit = JointFit(test.sums, candidates.products, faults, marks, variance, straddling)
        size = float(candidates.products.sizes[mark, fault])
        left = float(fit.coefficients[1:].sum())
        dead = max(test.dead_zone[fault] / size, test.relative_dead_zone * finding.coefficient)
        return left if left > max(dead, 2.0 * sqrt(fit.error)) else 0.0

    def ended_s(self, finding: Finding) -> float | None:
        """Return when a leak went again, to half a second or so; None while it may be there."""
        if finding.grown is not None or self.present(finding) > 0.0:
            return None
        change = self._test.candidates(finding).change
        return self._test.sums.start_s(int(np.argmax(change)))

    def passed(self, finding: Finding, named_s: float) -> Finding | None:
        """Return a leak as it was until it went, None if it did not or does not stand out so.

        Blocks without the leak hide it from a test for leaks that stay. Of a leak that was claimed
        the same blocks still speak, where what came after it counts as its end.

        Args:
            finding: the leak when it was claimed.
            named_s: when it was last claimed, near its end.
        """
        test = self._test
        sums = test.sums
        end = sums.mark_at(named_s)
        if end == sums.marks:
            return None
        candidates = test.candidates(replace(finding, onset=int(sums.mark_blocks[end])))
        begun = int(np.argmax(candidates.before))
        if candidates.before[begun] == 0.0:
            return None
        leak = replace(finding, onset=int(sums.mark_blocks[begun]))
        leak = replace(leak, coefficient=float(candidates.scores.coefficient[begun, leak.fault]))
        ended_s = self.ended_s(leak)
        if ended_s is None:
            return None
        gone = replace(leak, onset=int(sums.mark_blocks[sums.mark_at(ended_s)]))
        leak = replace(test.beside(leak, gone), ended_s=ended_s)
        return leak if leak.statistic > leak.limit else None

    def probabilities(self) -> Array:
        """Return the probabilities (7,) of no fault, of each fault alone, and of two of them.

        By Bayes' rule, with every onset as probable as any other and the coefficient anywhere up to
        `GREATEST_FLOW`; what a dead zone may hide speaks for no fault.
        """
        test = self._test
        candidates = test.candidates()
        scores, usable = candidates.scores, candidates.usable
        lasting = next((fault.lasting for fault in test.likely()), 1.0)
        size = np.where(usable, candidates.products.sizes, 1.0)
        error = np.sqrt(scores.variance * lasting / np.where(usable, scores.information, 1.0))
        surplus = np.maximum(scores.coefficient - test.dead_zone / size, 0.0) / error
        width = np.log(sqrt(2.0 * pi) / GREATEST_FLOW * size * error)
        onsets = max(test.sums.marks, 1)
        logs = np.where(usable, 0.5 * surplus**2 + np.minimum(width, 0.0), -np.inf)
        each = np.logaddexp.reduce(logs, axis=0) + log(PRIOR / onsets)
        pair = -np.inf
        if len(findings := test.search()) > 1:
            flows = [
                f.deviation * candidates.products.sizes[test.mark(f), f.fault] for f in findings
            ]
            pair = sum(
                0.5 * f.statistic**2 + log(PRIOR / onsets * sqrt(2.0 * pi) / GREATEST_FLOW * flow)
                for f, flow in zip(findings, flows, strict=True)
            )
        healthy = log(1.0 - FAULT_COUNT * PRIOR)
        weights = np.concatenate([[healthy], each, [pair]])
        weights = np.exp(weights - weights.max())
        return np.asarray(weights / weights.sum())
