"""Innovations are shared out among the frequencies that they have."""

import numpy as np
import pytest

from estimator.gap.prediction.bands import band_powers, edges

PERIOD = 1e-3


def test_a_sine_is_in_its_band_with_its_mean_square() -> None:
    time_s = PERIOD * np.arange(6000)
    innovations = np.stack([3.0 * np.sin(40.0 * np.pi * time_s), 0.0 * time_s], axis=1)
    powers = band_powers(innovations, PERIOD)
    band = int(np.searchsorted(edges(PERIOD), 20.0, side="right")) - 1
    assert powers[band, 0] == pytest.approx(4.5, rel=1e-3)
    assert powers[:, 0].sum() == pytest.approx(4.5, rel=1e-3)
    assert powers[:, 1].sum() == 0.0


@pytest.mark.parametrize("rows", [300, 1001, 20_000])
def test_white_noise_fills_the_bands_by_their_width(rows: int) -> None:
    noise = np.random.default_rng(1).standard_normal((rows, 1))
    noise[5] = np.nan
    powers = band_powers(noise, PERIOD)[:, 0]
    widths = np.diff(edges(PERIOD))
    assert powers.sum() == pytest.approx(np.nanmean(noise**2), rel=0.3)
    assert powers[-2:] == pytest.approx(widths[-2:] / 500.0, rel=0.5)


def test_the_highest_band_ends_at_half_the_rate_of_any_plant() -> None:
    assert edges(0.01) == (0.0, 1.0, 3.0, 10.0, 30.0, 50.0)
