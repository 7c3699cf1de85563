"""The limit of a sequential test is crossed by noise as often as its formula says."""

import numpy as np
import pytest
from scipy import stats

from estimator.accounts.crossings import LEAST_LIMIT, crossing_rate, limit_at

LEAST, MOST = 4, 200


def first_crossings(limit: float, series: int, blocks: int) -> tuple[int, int]:
    """Return how many series of noise cross, and the blocks that all took until then or their end.

    The score of an onset is the mean of the noise since, over its standard error.
    """
    rng = np.random.default_rng(3)
    count = exposure = 0
    windows = np.arange(LEAST, MOST + 1)
    for _ in range(series):
        sums = np.concatenate([[0.0], np.cumsum(rng.standard_normal(blocks + MOST))])
        ends = np.arange(MOST + 1, blocks + MOST + 1)
        scores = (sums[ends, None] - sums[ends[:, None] - windows]) / np.sqrt(windows)
        above = np.flatnonzero(scores.max(axis=1) > limit)
        # What is above from the first block on began before.
        if above.size and above[0] == 0:
            continue
        count += above.size > 0
        exposure += int(above[0]) if above.size else blocks
    return count, exposure


@pytest.mark.parametrize("limit", [3.0, 3.4])
def test_noise_crosses_a_limit_at_the_rate_of_the_formula(limit: float) -> None:
    """Within the count's 95 % interval and the 15 % that the approximation is off by."""
    count, exposure = first_crossings(limit, 300, 400)
    assert count > 50
    mean = crossing_rate(limit, LEAST, MOST) * exposure
    low, high = stats.chi2.ppf(0.025, 2 * count) / 2.0, stats.chi2.ppf(0.975, 2 * count + 2) / 2.0
    assert 0.85 * low < mean < 1.15 * high


@pytest.mark.parametrize("rate", [1e-9, 1e-6, 1e-3, 5e-3])
@pytest.mark.parametrize("most", [16, 240, 100_000])
def test_the_limit_of_a_rate_has_that_rate(rate: float, most: int) -> None:
    assert crossing_rate(limit_at(rate, LEAST, most), LEAST, most) == pytest.approx(rate, rel=1e-4)


def test_a_rate_beyond_rare_events_gets_the_least_limit() -> None:
    assert limit_at(0.5, LEAST, MOST) == LEAST_LIMIT
