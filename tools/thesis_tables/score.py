"""Counts how often each detector was right over the tests of a campaign."""

from collections.abc import Sequence
from dataclasses import dataclass

from faults.leakage import to_litres_per_minute

from .measures import true_flow
from .trials import Trial


@dataclass(frozen=True)
class Score:
    """Counts over some tests, for the thesis's pattern and for the product's detector.

    Attributes:
        leaks, healthy: number of tests with and without a leak.
        pattern_right, product_right: leaks whose test ends with the verdict that it expects.
        pattern_early: tests with a leak in which the pattern named a fault just before the leak.
        pattern_alarms, product_alarms: healthy tests whose last verdict was not healthy.
        covered: leaks that the product names right, with the true flow in its 95 % interval.
    """

    leaks: int
    healthy: int
    pattern_right: int
    pattern_early: int
    pattern_alarms: int
    product_right: int
    product_alarms: int
    covered: int


def score(trials: Sequence[Trial]) -> Score:
    """Return the counts over the given tests."""
    leaks = [t for t in trials if t.leak is not None]
    healthy = [t for t in trials if t.leak is None]
    early = [t.pattern_before_leak for t in leaks]
    return Score(
        leaks=len(leaks),
        healthy=len(healthy),
        pattern_right=sum(t.thesis.decision.verdict == t.test.expect for t in leaks),
        pattern_early=sum(d is not None and d.verdict != "healthy" for d in early),
        pattern_alarms=sum(t.thesis.decision.verdict != "healthy" for t in healthy),
        product_right=sum(t.product.decision.verdict == t.test.expect for t in leaks),
        product_alarms=sum(t.product.decision.verdict != "healthy" for t in healthy),
        covered=sum(_is_covered(t) for t in leaks),
    )


def _is_covered(trial: Trial) -> bool:
    decision, truth = trial.product.decision, true_flow(trial)
    interval = decision.interval_m3_per_s
    if decision.verdict != trial.test.expect or interval is None or truth is None:
        return False
    low, high = (to_litres_per_minute(limit) for limit in interval)
    return low <= truth <= high
