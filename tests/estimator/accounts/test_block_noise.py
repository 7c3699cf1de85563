"""Noise that lasts from block to block is noticed, and never taken for less than it is."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.block_noise import MOST_LASTING, RECENT, RecentBlocks, lasting_noise
from estimator.accounts.nuisances import NUISANCE_COUNT
from estimator.accounts.sums import SHAPE_COUNT

Array = NDArray[np.float64]


def lasting(rho: float, count: int, runs: int) -> Array:
    """Return noise (runs, count, 2); what is drawn for a run is the same for any number of them."""
    noise = np.stack([np.random.default_rng(seed).standard_normal((count, 2))
                      for seed in range(runs)])  # fmt: skip
    for k in range(1, count):
        noise[:, k] = rho * noise[:, k - 1] + np.sqrt(1.0 - rho**2) * noise[:, k]
    return noise


@pytest.mark.parametrize("rho", [0.0, 0.3, 0.6])
def test_it_is_what_a_mean_of_such_noise_varies_by(rho: float) -> None:
    told = np.mean([lasting_noise(noise) for noise in lasting(rho, 40000, 3)])
    means = lasting(rho, 100, 1500).mean(axis=1)
    assert told == pytest.approx(100.0 * np.var(means), rel=0.1)


@pytest.mark.parametrize("rho", [0.0, 0.3])
def test_few_blocks_err_on_the_safe_side(rho: float) -> None:
    told = np.array([lasting_noise(noise) for noise in lasting(rho, 20, 300)])
    assert np.mean(told >= (1.0 + rho) / (1.0 - rho)) > 0.9


def test_alternating_noise_earns_nothing_and_a_drift_is_bounded() -> None:
    alternating = np.array([[1.0, -1.0], [-1.0, 1.0]] * 30)
    drift = np.linspace(-1.0, 1.0, 60)[:, None] * np.ones(2)
    assert lasting_noise(alternating) == 1.0
    assert lasting_noise(drift) == pytest.approx((1.0 + MOST_LASTING) / (1.0 - MOST_LASTING))
    assert lasting_noise(np.zeros((5, 2))) == 1.0


def test_residuals_are_what_nuisances_and_faults_leave() -> None:
    rng = np.random.default_rng(1)
    recent = RecentBlocks()
    count = RECENT + 50
    nuisances = rng.standard_normal((count, 2, NUISANCE_COUNT))
    faults = rng.standard_normal((count, 2, SHAPE_COUNT))
    noise = rng.standard_normal((count, 2))
    sizes = rng.standard_normal(NUISANCE_COUNT)
    onset = count - 20
    present = (np.arange(count) >= onset)[:, None]
    missing = noise + nuisances @ sizes + 3.0 * present * faults[:, :, 2]
    for k in range(count):
        recent.add(missing[k], nuisances[k], faults[k])
    assert recent.residuals(sizes, [(2, onset, 3.0)]) == pytest.approx(noise[-RECENT:])
