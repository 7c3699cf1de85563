"""The thesis's pattern, with thresholds that are learnt instead of set by eye."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import FILTERS, FilterRun
from estimator.leaks.detection import Decision
from estimator.leaks.oil_account import Samples
from estimator.leaks.pattern import LEARNING_S, PatternDetector, healthy_level, learn_pattern

Array = NDArray[np.float64]

LEVEL = np.array([1.0e5, 0.8e5])


def innovations(seconds: float, seed: int, factor: tuple[float, float] = (1.0, 1.0)) -> Array:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((round(seconds * 1000), 2)) * LEVEL * np.array(factor)


def fed(detector: PatternDetector, series: Array, piece: int = 500) -> list[Decision]:
    decisions = []
    for start in range(0, len(series), piece):
        part = series[start : start + piece]
        time_s = 1e-3 * np.arange(start, start + len(part), dtype=np.float64)
        nothing = np.full(len(part), np.nan)
        outputs = np.full((len(part), 9), np.nan)
        outputs[:, 1:3] = part
        run = FilterRun(FILTERS["thesis-6"], time_s, np.zeros((len(part), 6)), outputs, np.eye(6))
        detector.update(Samples(time_s, *[nothing] * 6), run)
        decisions.append(detector.decide())
    return decisions


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [
        ((1.0, 1.0), "healthy"),
        ((2.5, 1.0), "external_leakage_1"),
        ((1.0, 2.5), "external_leakage_2"),
        ((2.0, 2.0), "internal_leakage"),
        ((4.0, 1.3), "external_leakage_1"),
    ],
)
def test_one_chamber_up_is_an_external_leak_and_both_an_internal_one(
    factor: tuple[float, float], verdict: str
) -> None:
    series = np.concatenate([innovations(20, 1), innovations(12, 2, factor)])
    decision = fed(PatternDetector(1.0), series)[-1]
    assert decision.verdict == verdict
    if verdict != "healthy":
        assert decision.onset_s == pytest.approx(22.0, abs=2.0)


def test_it_says_nothing_while_it_learns() -> None:
    decisions = fed(PatternDetector(1.0), innovations(LEARNING_S + 5.0, 3))
    verdicts = [decision.verdict for decision in decisions]
    assert verdicts.count("inconclusive") == round(LEARNING_S / 0.5)
    assert verdicts[-1] == "healthy"


def test_with_a_baseline_it_need_not_learn() -> None:
    baseline = learn_pattern([innovations(30, 4)], 1.0)
    series = innovations(12, 5, (2.5, 1.0))
    assert fed(PatternDetector(1.0, baseline), series)[-1].verdict == "external_leakage_1"


def test_healthy_averages_exceed_their_thresholds_no_more_often_than_stated() -> None:
    """At 1000 a day, 300 healthy runs of 20 s allow 69 alarms."""
    alarms = 0
    for seed in range(300):
        baseline = learn_pattern([innovations(30, 1000 + seed)], 1000.0)
        decisions = fed(PatternDetector(1000.0, baseline), innovations(20, seed), piece=2000)
        alarms += any(decision.verdict != "healthy" for decision in decisions)
    assert alarms < 1000.0 / 86400.0 * 300 * 20


def test_fewer_false_alarms_need_higher_thresholds() -> None:
    level = healthy_level([innovations(30, 6)])
    assert np.all(level.baseline(0.1).thresholds > level.baseline(10.0).thresholds)


def test_less_healthy_running_needs_higher_thresholds() -> None:
    short, long_ = (
        learn_pattern([innovations(5, 7)], 1.0),
        learn_pattern([innovations(300, 7)], 1.0),
    )
    assert np.all(short.thresholds - short.normal > long_.thresholds - long_.normal)


def test_too_little_healthy_running_is_refused() -> None:
    with pytest.raises(ValueError, match="give at least 8"):
        learn_pattern([innovations(3, 8)], 1.0)


@pytest.mark.parametrize("apart", [4, 10])
def test_samples_that_are_missing_leave_the_pattern_as_it_is(apart: int) -> None:
    series = np.concatenate([innovations(20, 1), innovations(12, 2, (2.5, 1.0))])
    series[np.arange(len(series)) % apart != 0] = np.nan
    series[5000:6000] = np.nan
    assert fed(PatternDetector(1.0), series)[-1].verdict == "external_leakage_1"
