"""Sums of sines: their phases, and how far they can reach at any time."""

from math import cos, gcd, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Points a period of the fastest sine; the bound below is then at most 0.5 % above the true peak.
_POINTS_PER_PERIOD: Final = 32


def schroeder_phases(count: int) -> NDArray[np.float64]:
    """Return the phases in rad (count,) that keep the peak of a flat multisine low.

    phase_k = -pi k (k - 1) / count (Schroeder 1970, IEEE Trans. Inf. Theory 16, 85).
    """
    k = np.arange(1, count + 1, dtype=np.float64)
    return -pi * k * (k - 1.0) / count


def random_phases(count: int, seed: int) -> NDArray[np.float64]:
    """Return phases in rad (count,), uniform over a turn."""
    return 2.0 * pi * np.random.Generator(np.random.PCG64(seed)).random(count)


def supremum(
    harmonics: NDArray[np.intp], amplitudes: NDArray[np.float64], phases: NDArray[np.float64]
) -> float:
    """Return a bound, at most 0.5 % too high, on |sum_i a_i sin(h_i x + phase_i)| over all x.

    The harmonics h_i (n,) are distinct positive integers; amplitudes a_i and phases (rad) are (n,).
    A trigonometric polynomial of degree N is at most 1 / cos(pi N / M) above its largest value on
    M > 2 N equidistant points of its period (Ehlich and Zeller 1964, Math. Z. 86, 41).
    """
    degrees = harmonics // gcd(*harmonics.tolist())
    points = _POINTS_PER_PERIOD * int(degrees.max())
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    # The inverse transform of c at h is 2 |c| cos(h x + arg c) / points, and sin is cos less pi/2.
    spectrum[degrees] = 0.5 * points * amplitudes * np.exp(1j * (phases - 0.5 * pi))
    grid_peak = float(np.max(np.abs(np.fft.irfft(spectrum, points))))
    # One part in 10^9 covers the rounding of the transform.
    return grid_peak / cos(pi / _POINTS_PER_PERIOD) * (1.0 + 1e-9)
