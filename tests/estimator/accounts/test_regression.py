"""Running sums give what a regression of all the blocks at once gives."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.flow import AccountBlock
from estimator.accounts.joint_fit import JointFit
from estimator.accounts.nuisances import NUISANCE_COUNT, NULL_SHIFT
from estimator.accounts.regression import Regression
from estimator.accounts.row import FAULT_COUNT
from estimator.accounts.sums import SHAPE_COUNT, SHIFT, AccountSums

Array = NDArray[np.float64]

COUNT = 40
ROOT = 2600.0


def rows(seed: int, noise: float = 1.0, count: int = COUNT) -> tuple[Array, Array, Array]:
    """Return missing flows (count, 2), nuisances (count, 2, n), faults and shift (count, 2, 6)."""
    rng = np.random.default_rng(seed)
    nuisances = rng.normal(0.0, 5.0, (count, 2, NUISANCE_COUNT))
    faults = ROOT * rng.uniform(0.5, 1.0, (count, 2, SHAPE_COUNT))
    faults[:, :, SHIFT] /= 0.1 * ROOT
    missing = nuisances @ rng.standard_normal(NUISANCE_COUNT) + noise * rng.standard_normal(
        (count, 2)
    )
    return missing, nuisances, faults


def summed(missing: Array, nuisances: Array, faults: Array) -> AccountSums:
    sums = AccountSums()
    for k in range(len(missing)):
        block = AccountBlock(
            0.5 * k, 0.5 * k + 0.5, missing[k], nuisances[k], faults[k, :, :5], np.ones(5), True
        )
        sums.add(block, (missing[k], nuisances[k], faults[k]))
    return sums


def column(faults: Array, fault: int, mark: int) -> Array:
    present = (np.arange(len(faults)) >= mark)[:, None]
    return np.asarray((faults[:, :, fault] * present).ravel())


def regression_of(sums: AccountSums) -> Regression:
    return Regression(*sums.nuisances(), 2 * sums.blocks)


@pytest.mark.parametrize("variance", [0.1, 1.0, 30.0])
def test_a_fault_scores_as_generalised_least_squares_has_it(variance: float) -> None:
    missing, nuisances, faults = rows(1)
    sums = summed(missing, nuisances, faults)
    products = sums.faults_since()
    scores = regression_of(sums).score(products.crossed, products, variance)
    y, f = missing.ravel(), nuisances.reshape(-1, NUISANCE_COUNT)
    for mark in (0, 7, 35):
        shift = NULL_SHIFT * column(faults, SHIFT, mark)[:, None]
        weight = np.linalg.inv(variance * np.eye(y.size) + f @ f.T + shift @ shift.T)
        for fault in range(FAULT_COUNT):
            u = column(faults, fault, mark)
            precision = u @ weight @ u
            k = u @ weight @ y / precision
            assert scores.coefficient[mark, fault] == pytest.approx(k, rel=1e-7)
            expected = precision * variance
            assert scores.information[mark, fault] == pytest.approx(expected, rel=1e-7)
            gained = k * k * precision * variance
            assert scores.explained[mark, fault] == pytest.approx(gained, rel=1e-6)


def test_a_signature_that_nuisances_can_make_up_tells_nothing() -> None:
    missing, nuisances, faults = rows(2)
    faults[:, :, 1] = nuisances[:, :, 3] * 1e9
    sums = summed(missing, nuisances, faults)
    products = sums.faults_since()
    scores = regression_of(sums).score(products.crossed, products, 1e-9)
    assert scores.information[0, 1] == 0.0
    assert scores.information[5, 1] > 0.0


@pytest.mark.parametrize("noise", [0.5, 1.0, 10.0])
def test_the_noise_is_told_from_the_nuisances(noise: float) -> None:
    """With the prior's weight: eight values of one beside 80 less 15."""
    told = [regression_of(summed(*rows(seed, noise))).variance for seed in range(20)]
    assert np.mean(told) == pytest.approx((8.0 + 65.0 * noise**2) / 73.0, rel=0.15)


def test_nuisances_lie_within_what_is_said_of_them() -> None:
    errors = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        rng.normal(0.0, 5.0, (COUNT, 2, NUISANCE_COUNT))
        rng.uniform(0.5, 1.0, (COUNT, 2, SHAPE_COUNT))
        drawn = rng.standard_normal(NUISANCE_COUNT)
        mean, covariance = regression_of(summed(*rows(seed))).nuisances()
        errors.append((mean - drawn) / np.sqrt(np.diag(covariance)))
    assert np.std(errors) == pytest.approx(1.0, abs=0.15)


def test_faults_fitted_together_are_those_of_one_regression() -> None:
    missing, nuisances, faults = rows(3)
    y = missing + 2e-3 * faults[:, :, 0] + 1e-3 * faults[:, :, 2]
    sums = summed(y, nuisances, faults)
    fit = JointFit(sums, [0, 2], [0, 12], 1.0)
    columns = [column(faults, 0, 0) / ROOT, column(faults, 2, 12) / ROOT]
    x = np.column_stack([nuisances.reshape(-1, NUISANCE_COUNT), *columns])
    ridge = np.diag([1.0] * NUISANCE_COUNT + [0.0, 0.0])
    inverse = np.linalg.inv(x.T @ x + ridge)
    expected = inverse @ x.T @ y.ravel()
    assert fit.nuisances == pytest.approx(expected[:NUISANCE_COUNT], rel=1e-6, abs=1e-9)
    assert fit.coefficients * ROOT == pytest.approx(expected[NUISANCE_COUNT:], rel=1e-6)
    assert fit.error * ROOT**2 == pytest.approx(inverse[-1, -1], rel=1e-6)

    residual = y.ravel() - x @ expected
    influence = x @ inverse[-1]
    by_block = (influence * residual).reshape(COUNT, 2).sum(axis=1)
    # Of the column less what the others make up of it (Frisch, Waugh and Lovell).
    kept = 1.0 - (influence**2).reshape(COUNT, 2).sum(axis=1) / inverse[-1, -1]
    shares = by_block**2 / kept
    assert fit.uneven_error() * ROOT**2 == pytest.approx(shares.sum(), rel=1e-6)
    without, error = fit.left_out()
    assert without * ROOT == pytest.approx(expected[-1] - by_block / kept, rel=1e-6)
    left = np.maximum(inverse[-1, -1], shares.sum() - shares) / kept
    assert error * ROOT**2 == pytest.approx(left, rel=1e-6)


def test_blocks_in_which_a_fault_settles_can_be_passed_over() -> None:
    missing, nuisances, faults = rows(5)
    y = missing + 1e-3 * (np.arange(COUNT) >= 20)[:, None] * faults[:, :, 1]
    wild = y.copy()
    wild[20:22] += 30.0
    passing = []
    for each in (y, wild):
        sums = summed(each, nuisances, faults)
        fit = JointFit(sums, [SHIFT, 1], [20, 20], 1.0, [(20, 22)])
        passing.append([*fit.nuisances, *fit.coefficients * ROOT, fit.error * ROOT**2])
        assert np.all(fit.left_out()[0][20:22] == fit.coefficients[-1])
    assert passing[0] == pytest.approx(passing[1], rel=1e-9)


@pytest.mark.parametrize("part", [0.0, 0.3, 1.0])
def test_the_block_in_which_a_fault_began_tells_when(part: float) -> None:
    missing, nuisances, faults = rows(4, count=200)
    present = np.where(np.arange(200) >= 100, 1.0, 0.0)
    present[99] = part
    y = missing + 2e-2 * present[:, None] * faults[:, :, 1]
    sums = summed(y, nuisances, faults)
    fit = JointFit(sums, [1], [100], 1.0)
    assert fit.began_before() == pytest.approx(part, abs=0.2)
