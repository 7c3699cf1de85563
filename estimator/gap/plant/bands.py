"""At which frequencies predictions err: power of innovations by frequency band (Welch 1967)."""

from typing import Final

import numpy as np

from .interface import Array

EDGES_HZ: Final = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Lower ends of the bands; each goes on to the next, the last to half the sampling rate."""
_SEGMENT_S: Final = 1.0
"""Segments of this length tell 1 Hz from 2."""


def edges(period: float) -> tuple[float, ...]:
    """Return the ends of the bands in Hz for a sampling period in s, the highest last."""
    highest = 0.5 / period
    return (*(edge for edge in EDGES_HZ if edge < highest), highest)


def band_powers(innovations: Array, period: float) -> Array:
    """Return the mean square of innovations in each band, float64 (bands, outputs).

    Segments of 1 s, half overlapping, under Hann's window; shorter records are one segment.

    Args:
        innovations: (n, outputs), over their standard deviations; missing ones count as none.
        period: of sampling, s.
    """
    length = min(round(_SEGMENT_S / period), len(innovations))
    window = np.hanning(length + 1)[:length]
    finite = np.nan_to_num(innovations, nan=0.0, posinf=0.0, neginf=0.0)
    starts = range(0, len(finite) - length + 1, max(length // 2, 1))
    power = np.zeros((length // 2 + 1, finite.shape[1]))
    for start in starts:
        part = finite[start : start + length] * window[:, None]
        power += np.abs(np.fft.rfft(part, axis=0)) ** 2
    power /= len(starts) * length * (window**2).sum()
    # Each frequency stands for its negative as well, but for none and for half the rate.
    last = len(power) if length % 2 else len(power) - 1
    power[1:last] *= 2.0
    frequencies = np.fft.rfftfreq(length, period)
    ends = np.array(edges(period))
    band = np.clip(np.searchsorted(ends, frequencies, side="right") - 1, 0, len(ends) - 2)
    found = np.zeros((len(ends) - 1, finite.shape[1]))
    np.add.at(found, band, power)
    return found
