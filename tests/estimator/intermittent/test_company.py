"""What a leak goes with is named when its openings keep step with it, and rarely otherwise."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.intermittent import Company, Episode
from estimator.intermittent.company import CHANCE, company

Array = NDArray[np.float64]

START_S: Array = np.arange(240, dtype=np.float64) * 0.5
END_S: Array = START_S + 0.5


def motion(seed: int) -> dict[str, Array]:
    """Return a motion whose position, direction and pressures differ."""
    rng = np.random.default_rng(seed)
    middle = 0.5 * (START_S + END_S)
    wave = sum(
        np.sin(2.0 * np.pi * f * middle + rng.uniform(0.0, 6.0)) / f for f in (0.11, 0.17, 0.23)
    )
    position = 0.3 + 0.01 * np.asarray(wave)
    return {
        "position": position,
        "direction": np.gradient(position, middle),
        "pressure_1": 7e6 + 1e5 * rng.standard_normal(middle.size),
        "pressure_2": 7e6 + 1e5 * rng.standard_normal(middle.size),
    }


def found(open_: NDArray[np.bool_], candidates: dict[str, Array]) -> Company | None:
    edges = np.flatnonzero(np.diff(np.r_[False, open_, False].astype(np.int8)))
    episodes = tuple(
        Episode(float(START_S[a]), float(END_S[b - 1]), 1e-6)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    )
    return company(episodes, START_S, END_S, open_.astype(np.float64), candidates)


def test_a_leak_beyond_a_position_is_said_to_be_so_and_where() -> None:
    candidates = motion(1)
    with_ = found(candidates["position"] > 0.31, candidates)
    assert with_ is not None
    assert (with_.what, with_.sense) == ("position", 1)
    assert with_.beyond == pytest.approx(0.31, abs=0.005)
    assert with_.chance <= CHANCE


@pytest.mark.parametrize("sense", [1, -1])
def test_a_leak_in_one_direction_is_said_to_be_so(sense: int) -> None:
    candidates = motion(2)
    with_ = found(sense * candidates["direction"] > 0.0, candidates)
    assert with_ is not None
    assert (with_.what, with_.sense) == ("direction", sense)


def random_openings(seed: int) -> NDArray[np.bool_]:
    rng = np.random.default_rng((seed, 1))
    lengths = rng.integers(2, 14, 60)
    return np.repeat(np.arange(60) % 2 == 0, lengths)[:240]


def test_openings_at_random_times_go_with_nothing() -> None:
    named = [found(random_openings(seed), motion(seed)) for seed in range(10)]
    assert sum(each is not None for each in named) == 0


def test_a_leak_at_regular_times_goes_with_time() -> None:
    with_ = found(np.arange(240) % 17 < 5, motion(3))
    assert with_ is not None
    assert with_.what == "time"
    assert with_.period_s == pytest.approx(8.5, abs=0.1)


def test_five_openings_are_too_few_to_say() -> None:
    candidates = motion(1)
    early = (candidates["position"] > 0.31) & (np.cumsum(candidates["position"] > 0.31) < 40)
    edges = np.flatnonzero(np.diff(np.r_[False, early, False].astype(np.int8)))
    assert found(early & (np.arange(240) < edges[10]), candidates) is None
