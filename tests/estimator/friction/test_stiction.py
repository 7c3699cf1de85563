"""Stiction along the stroke: a mean with an interval, and a trend only where there is one."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.friction.break_away import BreakAway
from estimator.friction.stiction import NO_LEVEL, stiction_level

PLACES = np.linspace(0.03, 0.58, 10)


def found(
    rng: np.random.Generator, trend: float = 0.0, spring: float = 0.0
) -> list[tuple[BreakAway, BreakAway]]:
    """Return break-aways of 2400 N and an offset of 50 N, with 3 N of noise."""
    places = []
    for place in PLACES:
        level = 2400.0 + trend * (place - 0.3) + 3.0 * rng.standard_normal()
        offset = 50.0 + spring * (place - 0.3) + 3.0 * rng.standard_normal()
        places.append(
            (
                BreakAway(-1, place, offset - level, 3.0, -1e-4, 2e-3),
                BreakAway(1, place, offset + level, 3.0, 1e-4, 2e-3),
            )
        )
    return places


def test_the_interval_holds_the_level_in_95_of_100_and_trends_are_rarely_imagined() -> None:
    rng = np.random.default_rng(1)
    levels = [stiction_level(found(rng)) for _ in range(400)]
    held = np.mean([abs(each.level - 2400.0) < 1.96 * each.level_error for each in levels])
    assert 0.92 <= held <= 0.98
    imagined = np.mean([each.level_trend.significant for each in levels])
    assert imagined < 0.03


def test_stiction_that_depends_on_the_position_is_told_from_a_spring() -> None:
    rng = np.random.default_rng(2)
    worn = stiction_level(found(rng, trend=100.0))
    assert worn.level_trend.significant
    assert worn.level_trend.slope == pytest.approx(100.0, abs=25.0)
    assert not worn.offset_trend.significant
    sprung = stiction_level(found(rng, spring=100.0))
    assert sprung.offset_trend.significant
    assert not sprung.level_trend.significant


def test_places_where_the_ram_did_not_take_off_both_ways_do_not_count() -> None:
    places = found(np.random.default_rng(3))
    still = [(replace(back, travel=1e-4), out) for back, out in places[:7]]
    assert stiction_level([*still, *places[7:]]) is NO_LEVEL
    assert stiction_level([*still[:2], *places[2:]]).places == len(PLACES) - 2
