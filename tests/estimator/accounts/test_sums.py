"""Sums over the accounts stay bounded, and lose nothing but old onsets."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.fit_sums import influence_weights
from estimator.accounts.flow import AccountBlock
from estimator.accounts.nuisances import NUISANCE_COUNT
from estimator.accounts.row import FAULT_COUNT
from estimator.accounts.sums import MARKS, SHIFT, AccountSums

Array = NDArray[np.float64]


def block(k: int) -> AccountBlock:
    rng = np.random.default_rng(k)
    return AccountBlock(
        0.5 * k,
        0.5 * k + 0.5,
        rng.standard_normal(2),
        rng.standard_normal((2, NUISANCE_COUNT)),
        rng.standard_normal((2, FAULT_COUNT)),
        rng.uniform(1.0, 2.0, FAULT_COUNT) / 6e4,
        True,
        position_range=(0.3 - 1e-4 * k, 0.3 + 1e-4 * k),
        supply_pressure=13.8e6 + 1e3 * k,
    )


def shapes(each: AccountBlock) -> Array:
    """Return a block's faults and what a shift of the null would look like: (2, 6)."""
    return np.column_stack([each.faults, each.nuisances[:, 0]])


def summed(count: int, kept: tuple[int, ...] = ()) -> AccountSums:
    sums = AccountSums()
    for k in range(count):
        each = block(k)
        sums.add(each, (each.missing, each.nuisances, shapes(each)), kept)
    return sums


@pytest.mark.parametrize("count", [1, MARKS, MARKS + 1, 1000])
def test_sums_since_a_mark_are_those_of_the_blocks_after_it(count: int) -> None:
    sums = summed(count)
    products = sums.faults_since()
    assert sums.marks == len(sums.mark_blocks) <= MARKS
    for mark in (0, sums.marks // 2, sums.marks - 1):
        later = [block(k) for k in range(int(sums.mark_blocks[mark]), count)]
        squares = sum(shapes(each).T @ shapes(each) for each in later)
        crossed = sum(shapes(each).T @ each.nuisances for each in later)
        missing = sum(shapes(each).T @ each.missing for each in later)
        sizes = 6e4 * np.mean([each.sizes for each in later], axis=0)
        assert products.squares[mark] == pytest.approx(squares, abs=1e-9)
        assert products.crossed[mark] == pytest.approx(crossed, abs=1e-9)
        assert products.products[mark] == pytest.approx(missing, abs=1e-9)
        assert products.sizes[mark] == pytest.approx(sizes)
        assert sums.mean_sizes(mark) == pytest.approx(sizes)
        assert products.blocks[mark] == len(later)
        assert sums.seconds(mark) == pytest.approx(0.5 * len(later))
        assert sums.start_s(mark) == 0.5 * sums.mark_blocks[mark]


def test_the_last_minute_keeps_every_onset_and_the_past_some() -> None:
    sums = summed(5000)
    assert np.diff(sums.mark_blocks[-100:]).max() == 1
    age = 5000 - sums.mark_blocks[:-1]
    assert np.all(np.diff(sums.mark_blocks) <= np.maximum(1, age / 4))


def test_an_onset_that_was_found_is_not_thinned_out() -> None:
    kept = (37, 38, 39)
    assert set(kept) <= set(summed(3000, kept).mark_blocks.tolist())
    assert not set(kept) <= set(summed(3000).mark_blocks.tolist())


def test_thinning_keeps_travel_and_supply_pressure() -> None:
    sums = summed(1000)
    assert sums.travel(0) == pytest.approx(2e-4 * 999)
    count, mean, spread = sums.supply(0)
    assert count == 1000.0
    assert mean == pytest.approx(13.8e6 + 1e3 * 499.5)
    assert spread == pytest.approx(1e3 * np.std(np.arange(1000)), rel=1e-3)
    assert sums.supply(0, 0)[0] == 0.0


def test_weighted_sums_are_forms_of_the_blocks() -> None:
    sums = summed(30)
    rng = np.random.default_rng(0)
    left, right = rng.standard_normal((2, NUISANCE_COUNT + 2))
    faults = [1, SHIFT]
    weights = influence_weights(left, right, np.array(faults), 2.0)
    found = sums.weighted(weights, 10, 20)
    for k in range(10, 20):
        x = np.column_stack([block(k).nuisances, shapes(block(k))[:, faults]])
        expected = left @ x.T @ (block(k).missing - x @ right), left @ x.T @ x @ left / 2.0
        assert found[k - 10] == pytest.approx(expected, abs=1e-9)


def test_nuisances_can_be_told_without_some_blocks() -> None:
    sums = summed(30)
    rest = [block(k) for k in range(30) if not 10 <= k < 12]
    squares, products, power = sums.nuisances(without=[(10, 12)])
    assert squares == pytest.approx(sum(b.nuisances.T @ b.nuisances for b in rest), abs=1e-9)
    assert products == pytest.approx(sum(b.nuisances.T @ b.missing for b in rest), abs=1e-9)
    assert power == pytest.approx(sum(b.missing @ b.missing for b in rest), abs=1e-9)
