"""Peaks over a low limit tell how often higher ones are exceeded, and how sure that is."""

import numpy as np
import pytest

from estimator.learnt.tail import HOURS_DIFFER, RegimePeaks, Tail, tail_of

RIGS = 1000
HOURS = {"moving": 0.75, "creep": 0.25}
"""Time in each regime, h."""
PEAKS = {"moving": 20.0, "creep": 40.0}
"""True number of peaks in an hour of each regime."""


@pytest.fixture(scope="module")
def tails() -> list[Tail]:
    """Return tails of rigs with 25 peaks over 3 and a mean excess of some 0.5 in an hour."""
    rng = np.random.default_rng(1)
    return [hour_of(rng) for _ in range(RIGS)]


def steepness(rng: np.random.Generator) -> float:
    """Return the inverse mean excess of an hour."""
    return float(rng.gamma(1.0 / HOURS_DIFFER, 2.0 * HOURS_DIFFER))


def hour_of(rng: np.random.Generator) -> Tail:
    excess = 1.0 / steepness(rng)
    peaks = [
        (3.0 + rng.exponential(excess), name)
        for name, hours in HOURS.items()
        for _ in range(rng.poisson(PEAKS[name] * hours))
    ]
    return tail_of(peaks, 3.0, 1.0, HOURS)


def true_rate(limit: float, regime: str, steep: float) -> float:
    return float(24.0 * PEAKS[regime] * np.exp(-(limit - 3.0) * steep))


@pytest.mark.parametrize("regime", HOURS)
@pytest.mark.parametrize("stated", [100.0, 10.0])
def test_rigs_alarm_as_often_as_stated_on_average(
    tails: list[Tail], stated: float, regime: str
) -> None:
    rng = np.random.default_rng(2)
    rates = [true_rate(tail.limit(stated, regime), regime, steepness(rng)) for tail in tails]
    assert np.mean(rates) == pytest.approx(stated, rel=0.35)


def test_the_stated_interval_holds_the_rate_of_a_later_hour_nine_times_in_ten(
    tails: list[Tail],
) -> None:
    inside, rng = 0, np.random.default_rng(3)
    for tail in tails[:100]:
        low, high = tail.interval(10.0)
        steep = steepness(rng)
        rates = [
            true_rate(tail.limit(10.0, name), name, steep) * part for name, part in HOURS.items()
        ]
        inside += low <= sum(rates) <= high
    assert 0.75 < inside / 100 < 0.97


def test_the_limit_is_that_with_the_rate(tails: list[Tail]) -> None:
    tail = tails[0]
    assert tail.rate(tail.limit(7.0)) == pytest.approx(7.0)
    assert tail.rate(tail.limit(7.0, "creep"), "creep") == pytest.approx(7.0)


def test_a_regime_with_more_peaks_has_a_higher_limit() -> None:
    parts = (RegimePeaks("moving", 0.7, 10), RegimePeaks("creep", 0.3, 10))
    tail = Tail(1.0, 1.0, 20, 6.0, parts)
    assert tail.limit(10.0, "moving") < tail.limit(10.0) < tail.limit(10.0, "creep")


def test_rarer_alarms_need_a_higher_limit_and_are_less_sure() -> None:
    tail = Tail(3.0, 1.0, 10, 5.0)
    assert tail.limit(1.0) > tail.limit(10.0) > tail.limit(100.0) >= tail.base
    rare, often = (tail.interval(rate) for rate in (1.0, 100.0))
    assert rare[1] / rare[0] > often[1] / often[0]


def test_more_hours_make_it_surer() -> None:
    short, long = (Tail(3.0, hours, 10 * int(hours), 5.0 * hours) for hours in (1.0, 8.0))
    spans = [high / low for low, high in (t.interval(1.0) for t in (short, long))]
    assert spans[1] < 0.5 * spans[0]


def test_a_rig_without_a_peak_still_has_a_limit_for_each_rate() -> None:
    quiet = Tail(3.0, 0.5, 0, 0.0)
    assert quiet.limit(1.0) > quiet.limit(10.0) >= quiet.base
