"""Further answers from the blocks of a leak test, beside the faults that it finds.

They say how probable each fault is, whether leaks may be a fault of the lines, how much is left of
a leak, and how small a leak would have been found. All findings that the functions take must be
those of the given test.
"""

from collections.abc import Sequence
from dataclasses import replace
from math import hypot, log, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    FAULT_COUNT,
    INTERNAL_LEAKAGE,
    NUISANCES,
    SHIFT,
    SUPPLY_LEAKAGE,
    Intervals,
    JointFit,
    Ramp,
    RampFit,
    around,
    nuisance_index,
)
from rig.plant import LITRE_PER_MINUTE

from .fault_scores import RIVAL_GAIN
from .fault_size import LEAST_BLOCKS, Course, course_of
from .finding import Finding, Growth
from .growing import DURATIONS_S
from .leak_statistic import MINIMUM_BLOCKS, LeakTest

Array = NDArray[np.float64]

PRIOR: Final = 0.01
"""Prior probability of each fault: that a run has it."""
EDGE_ERROR: Final = 0.02
"""Relative standard deviation of a leak's flow by the tolerance of the metering edges, by which the
accounts measure it (`NUISANCES`)."""
GREATEST_FLOW: Final = 4.0
"""L/min: the prior of a fault's flow is uniform from 0 to this (figure 5.1: bypass lines)."""
_LEAST_RISING: Final = 3
"""Fewest stretches (of an eighth of the run each) over which a leak must rise."""
_DISCHARGE: Final = nuisance_index("discharge_coefficient")


def leaks_beside(test: LeakTest, dropped: Finding) -> list[Finding]:
    """Return the leak that stands out beside a measured drop of the supply pressure, in a list.

    The list is empty if no leak does, or with fewer than `MINIMUM_BLOCKS` blocks.
    """
    if test.blocks < MINIMUM_BLOCKS:
        return []
    mark = min(test.sums.mark_at(dropped.onset_s), test.sums.marks - 1)
    leak = test.best(replace(dropped, onset=int(test.sums.mark_blocks[mark])))
    return [] if leak is None or leak.fault >= SUPPLY_LEAKAGE else [leak]


def may_be_lines(test: LeakTest, findings: Sequence[Finding]) -> bool:
    """Return whether the findings may be a fault of the supply or return line.

    Such a fault changes both accounts, as an internal leak or two leaks do. It is ruled out if
    beside the first leak it explains next to nothing, or clearly less than the second leak does.
    The result is False if nothing was found or the supply pressure is measured. Otherwise it is
    True if a finding is itself a fault of the lines, and False for an external leak alone. A leak
    that grows leaves much to a fault of the lines while its size is taken for constant; it is then
    compared as one that may grow.
    """
    if not findings or test.sums.supply_measured:
        return False
    if any(finding.fault >= SUPPLY_LEAKAGE for finding in findings):
        return True
    first, *others = findings
    if not others and first.fault != INTERNAL_LEAKAGE:
        return False
    beside = test.candidates(first).gain
    line = float(beside[:, SUPPLY_LEAKAGE:].max())
    grows = test.blocks >= LEAST_BLOCKS or first.ramp is not None
    if not others and line >= RIVAL_GAIN and grows:
        line = min(line, _line_beside_growth(test, first))
    second = max((float(beside[:, other.fault].max()) for other in others), default=0.0)
    return line >= (second - RIVAL_GAIN if others else RIVAL_GAIN)


def _line_beside_growth(test: LeakTest, leak: Finding) -> float:
    """Return what a fault of the lines explains beside a leak that may grow over minutes.

    It is the gain in twice the log likelihood of the likelier of the two faults of the lines.
    """
    candidates = test.candidates(leak)
    course = _course(test, leak)
    fit, gains = course.fit, []
    for line in range(SUPPLY_LEAKAGE, FAULT_COUNT):
        mark = int(np.argmax(candidates.gain[:, line]))
        both = JointFit(test.sums, [*fit.faults, line], [*fit.marks, mark], course.variance)
        gains.append(both.explained - fit.explained)
    return max(gains) / course.variance


def _course(test: LeakTest, leak: Finding) -> Course:
    candidates = test.candidates()
    variance = candidates.regression.variance
    return course_of(test.sums, leak.fault, variance, test.model_error)


def growth_of(test: LeakTest, leak: Finding, size: float, bound: float = 0.0) -> Growth | None:
    """Return how a leak that was found alone grows, and its flow now; None if it does not grow.

    It grows if, over the stretches in which it is beyond the dead zone, it has risen by more than
    what the leak law may be wrong by (`relative_dead_zone`) and the dead zone, at the same rate of
    false alarms as a leak is found. It takes a run of a minute, and three such stretches.

    A leak that was found as one that grew (`Finding.ramp`) did so from nothing.

    Args:
        test: the test of the blocks.
        leak: the leak.
        size: its mean absolute flow per unit coefficient, m^3/s.
        bound: standard deviation of a leak's flow by errors of the model, m^3/s.
    """
    if leak.ramp is not None and leak.grown is not None:
        return _grown_from_nothing(test, leak, leak.ramp, leak.grown * size, bound)
    if test.blocks < LEAST_BLOCKS or leak.ended_s is not None:
        return None
    course = _course(test, leak)
    levels, sums = course.levels, test.sums
    low = np.flatnonzero(levels <= test.dead_zone[leak.fault] * LITRE_PER_MINUTE / size)
    # In the first stretch beyond the dead zone the leak may be there for a part of the time.
    first = int(low[-1]) + 2 if low.size else 1
    if levels.size - first < _LEAST_RISING:
        return None
    starts = [sums.start_s(int(mark)) for mark in course.marks]
    end_s = sums.start_s(sums.marks - 1) + sums.seconds(sums.marks - 1)
    half = 0.5 * (end_s - starts[-1])
    apart = end_s - half - 0.5 * (starts[first] + starts[first + 1])
    rise = float(levels[-1] - levels[first])
    error = sqrt(course.fit.error_of_sum(levels.size - 1 - first) * leak.lasting)
    allowed = test.relative_dead_zone * levels[-1]
    allowed = max(allowed, test.dead_zone[leak.fault] * LITRE_PER_MINUTE / size)
    if not rise - allowed > test.change_limit() * error:
        return None
    rate, rate_error = rise / apart, error / apart
    now = (float(levels[-1]) + rate * half) * size
    own = sqrt(course.fit.error_of_sum(levels.size) * leak.lasting)
    part = relative_error(test)
    return Growth(
        now, hypot(own * size, rate_error * half * size, part * now, bound),
        rate * size, hypot(rate_error, part * rate) * size,
        max(now - rate * size * (apart + half), 0.0), apart + half,
    )  # fmt: skip


def _grown_from_nothing(
    test: LeakTest, leak: Finding, ramp: Ramp, now: float, bound: float
) -> Growth:
    """Return the growth of a leak that grew along a ramp to a flow of `now`, m^3/s."""
    sums = test.sums
    last_s = sums.start_s(sums.marks - 1) + sums.seconds(sums.marks - 1)
    seconds = min(ramp.seconds, last_s - ramp.begin_s)
    error = hypot(now * leak.deviation / leak.coefficient, relative_error(test) * now, bound)
    return Growth(
        now, error, now / seconds, error / seconds, 0.0, seconds, ramp.begin_s,
        last_s - ramp.begin_s <= ramp.seconds + 1e-6,
    )  # fmt: skip


def relative_error(test: LeakTest) -> float:
    """Return the relative standard deviation of a leak's flow by that of the valve's edges.

    The accounts measure a leak by the flow past the edges: with the tolerance of single edges
    (`EDGE_ERROR`), and with that of the discharge coefficient as far as the blocks leave it open. A
    ram that moves shows the coefficient by its travel, one at rest does not.
    """
    belief = test.nuisances()
    open_part = sqrt(max(float(belief.covariance[_DISCHARGE, _DISCHARGE]), 0.0))
    return hypot(EDGE_ERROR, NUISANCES[_DISCHARGE].sigma * open_part)


def smallest_found(test: LeakTest, part: float = 0.5) -> Array:
    """Return the smallest coefficient with which each fault would have been found.

    Args:
        test: the test of the blocks.
        part: assumed onset of the fault, as a part of all blocks: 0 for the first, 1 for the last.

    Returns:
        float64 (5,), SI units, in the order of `FAULTS`; inf for a fault that does not show.
    """
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


def present_coefficient(test: LeakTest, finding: Finding) -> float:
    """Return a leak's coefficient as it is now, in SI units; 0 if the leak has ended.

    It differs from the finding's coefficient if the accounts show a change since the onset. The
    leak has ended if what is left is within the dead zone, within the error of the leak law
    (`relative_dead_zone` of the coefficient), or within two standard errors. A leak that grows over
    minutes has its latest coefficient (`Finding.grown`), and never counts as ended.
    """
    if finding.ramp is not None and finding.grown is not None:
        return _left_of_growth(test, finding, finding.ramp, finding.grown)
    if finding.grown is not None:
        return finding.grown
    candidates = test.candidates(finding)
    first, fault = test.mark(finding), finding.fault
    mark = int(np.argmax(candidates.change))
    if candidates.change[mark] < test.change_limit() ** 2:
        return finding.coefficient
    variance = float(candidates.scores.variance[mark, fault])
    faults, marks = [SHIFT, fault, fault], [mark, first, mark]
    straddling = around(marks, test.sums.marks)
    if len(straddling) == 1:
        # The leak changed so soon that no block has it throughout.
        straddling = []
    fit = JointFit(test.sums, faults, marks, variance, straddling)
    size = float(candidates.products.sizes[mark, fault])
    left = float(fit.coefficients[1:].sum())
    dead = max(test.dead_zone[fault] / size, test.relative_dead_zone * finding.coefficient)
    return left if left > max(dead, 2.0 * sqrt(fit.error)) else 0.0


def _left_of_growth(test: LeakTest, finding: Finding, ramp: Ramp, grown: float) -> float:
    """Return what is left of a leak that grew along a ramp, as `present_coefficient` does."""
    candidates = test.candidates(finding)
    mark, fault = int(np.argmax(candidates.change)), finding.fault
    if candidates.change[mark] < test.change_limit() ** 2:
        return grown
    intervals = Intervals(test.sums)
    level = intervals.level(ramp)
    changed = (np.arange(level.size) >= mark).astype(float)
    variance = float(candidates.scores.variance[mark, fault])
    fit = RampFit(intervals, [fault, fault], np.stack([level, changed]), variance)
    left = float(fit.coefficients[0] * level[-1] + fit.coefficients[1])
    dead = test.dead_zone[fault] / float(candidates.products.sizes[mark, fault])
    least = max(dead, test.relative_dead_zone * grown, 2.0 * sqrt(fit.error))
    return left if left > least else 0.0


def end_of(test: LeakTest, finding: Finding) -> float | None:
    """Return when a leak ended, in s, to half a second or so; None while it may be present.

    For a leak that grows over minutes it is always None.
    """
    slow = finding.grown is not None and finding.ramp is None
    if slow or present_coefficient(test, finding) > 0.0:
        return None
    change = test.candidates(finding).change
    return test.sums.start_s(int(np.argmax(change)))


def passed_leak(test: LeakTest, finding: Finding, named_s: float) -> Finding | None:
    """Return a claimed leak that has ended, sized up to its end; None if it does not stand out.

    The blocks after its end hide such a leak from a test for leaks that stay. It is therefore
    fitted once more with an end near the time at which it was last claimed.

    Args:
        test: the test of the blocks.
        finding: the leak as it was when it was claimed.
        named_s: time at which it was last claimed, s.

    Returns:
        The leak with `ended_s`. None if there are no blocks after `named_s`, if the accounts
        show no end, or if the statistic is not above the limit.
    """
    finding = replace(finding, ramp=None, grown=None)
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
    ended_s = end_of(test, leak)
    if ended_s is None:
        return None
    gone = replace(leak, onset=int(sums.mark_blocks[sums.mark_at(ended_s)]))
    leak = replace(test.beside(leak, gone), ended_s=ended_s)
    return leak if leak.statistic > leak.limit else None


def fault_probabilities(test: LeakTest) -> Array:
    """Return the probabilities (7,) of no fault, of each fault alone, and of two faults.

    They follow by Bayes' rule. Every onset is equally probable, and so is every flow up to
    `GREATEST_FLOW`. A flow within the dead zone is no evidence of a fault.
    """
    lasting = next((fault.lasting for fault in test.likely()), 1.0)
    onsets = max(test.sums.marks, 1)
    each = test.log_evidence(lasting, GREATEST_FLOW) + log(PRIOR / onsets)
    pair = -np.inf
    findings = test.search()
    grew = bool(findings) and findings[0].ramp is not None
    if len(findings) > 1 or grew:
        candidates = test.candidates()
        flows = [f.deviation * candidates.products.sizes[test.mark(f), f.fault] for f in findings]
        evidence = sum(
            0.5 * (test.sharpness() * f.statistic) ** 2
            + log(PRIOR / onsets * sqrt(2.0 * pi) / GREATEST_FLOW * flow)
            for f, flow in zip(findings, flows, strict=True)
        )
        if grew:
            at = findings[0].fault
            each[at] = np.logaddexp(each[at], evidence - log(len(DURATIONS_S)))
        else:
            pair = evidence
    healthy = log(1.0 - FAULT_COUNT * PRIOR)
    weights = np.concatenate([[healthy], each, [pair]])
    weights = np.exp(weights - weights.max())
    return np.asarray(weights / weights.sum())
