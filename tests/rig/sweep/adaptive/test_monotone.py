"""The size of which a share is found, known from outcomes and from nothing but monotony."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from rig.sweep.adaptive.batches import next_span
from rig.sweep.adaptive.monotone import TOLD, crossing, steps

Array = NDArray[np.float64]


def likelihood(found: Array, share: Array) -> float:
    with np.errstate(divide="ignore"):
        chances = np.where(found > 0.5, share, 1.0 - share)
    return float(np.log(np.maximum(chances, 1e-300)).sum())


def best_share(found: Array) -> Array:
    """Return the most likely growing share, by its formula: largest of least means (n,)."""
    sums = np.concatenate([[0.0], np.cumsum(found)])
    count = found.size
    return np.array(
        [
            max(
                min((sums[end] - sums[begin]) / (end - begin) for end in range(at + 1, count + 1))
                for begin in range(at + 1)
            )
            for at in range(count)
        ]
    )


outcomes = st.lists(st.booleans(), min_size=1, max_size=9).map(np.array)


@settings(max_examples=25, deadline=None)
@given(outcomes, st.sampled_from([0.5, 0.8, 0.95]))
def test_the_interval_is_that_of_the_likelihood_ratio(
    found: NDArray[np.bool_], share: float
) -> None:
    sizes: Array = np.arange(1.0, found.size + 1.0)
    values = found.astype(np.float64)
    best = likelihood(values, best_share(values))
    kept = []
    for at in range(found.size + 1):
        below = np.minimum(best_share(values[:at]), share)
        above = np.maximum(best_share(values[at:]), share)
        ratio = 2.0 * (best - likelihood(values, np.concatenate([below, above])))
        if ratio <= TOLD:
            kept.append(at)
    ends = np.concatenate([[-np.inf], sizes, [np.inf]])
    told = crossing(sizes, found, share)
    assert (told.low, told.high) == (ends[kept[0]], ends[kept[-1] + 1])
    assert steps(sizes, found)[1] == pytest.approx(best_share(values))


@settings(max_examples=25, deadline=None)
@given(outcomes, st.sampled_from([0.5, 0.8, 0.95]))
def test_what_is_missed_from_above_mirrors_what_is_found_from_below(
    found: NDArray[np.bool_], share: float
) -> None:
    sizes = np.arange(found.size, dtype=np.float64)
    told, mirrored = crossing(sizes, found, share), crossing(-sizes, ~found, 1.0 - share)
    assert (told.low, told.high) == (-mirrored.high, -mirrored.low)


def test_no_end_is_told_where_all_or_none_were_found() -> None:
    sizes = np.linspace(0.0, 1.0, 200)
    whole, none = np.ones(200, np.bool_), np.zeros(200, np.bool_)
    assert crossing(sizes, whole, 0.95).low == -np.inf
    assert crossing(sizes, whole, 0.95).high < 0.3
    assert crossing(sizes, none, 0.95).low > 0.9
    assert crossing(sizes, none, 0.95).high == np.inf


def test_sizes_drawn_more_than_once_count_together() -> None:
    sizes = np.repeat([1.0, 2.0, 3.0], 100)
    found = np.concatenate([np.arange(100) < 30, np.arange(100) < 99, np.ones(100, np.bool_)])
    told = crossing(sizes, found, 0.9)
    assert (told.low, told.middle, told.high) == (1.0, 1.5, 2.0)


def shelf(x: Array) -> Array:
    """Return a share that rests at 85 % before it rises to 1, which no usual curve follows."""
    low, high = (1.0 / (1.0 + np.exp(-46.0 * (x - at))) for at in (0.37, 0.54))
    return np.asarray(0.85 * low + 0.15 * high)


def test_the_interval_holds_the_true_size_of_a_curve_with_a_shelf() -> None:
    grid = np.linspace(0.0, 1.0, 10_001)
    true = float(grid[np.searchsorted(shelf(grid), 0.95)])
    held = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        sizes, found, span = np.empty(0), np.empty(0, np.bool_), (0.0, 1.0)
        for _ in range(5):
            more = random.uniform(*span, 40)
            sizes = np.concatenate([sizes, more])
            found = np.concatenate([found, random.random(40) < shelf(more)])
            span = next_span(crossing(sizes, found, 0.95))
        told = crossing(sizes, found, 0.95)
        held += told.low <= true <= told.high
    # Of 40 intervals that hold it in 95 of 100, fewer than 34 do so once in 100 times.
    assert held >= 34
