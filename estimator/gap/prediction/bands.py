"""Power of innovations by frequency band, which shows where predictions err (Welch 1967).

It also shows noise that sensors are stated to have and that recordings do not have.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Array

from .fit import Filtered
from .variables import Values

EDGES_HZ: Final = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
"""Lower ends of the frequency bands, Hz. Each band ends where the next begins, and the last at half
the sampling rate."""
_SEGMENT_S: Final = 1.0
"""Length of a segment, s. Segments of 1 s can separate 1 Hz from 2 Hz."""
_LEAST: Final = 20
"""Least number of samples in a segment."""
OVERSTATED: Final = 1.5
"""A band is short of noise if a twin has more than so many times its power. Chance changes the
median power of 16 blocks and more by a few per cent."""


def edges(period: float) -> tuple[float, ...]:
    """Return the ends of the bands in Hz, ascending, for a sampling period in s.

    The last end is half the sampling rate. Bands that begin at it or above it are left out.
    """
    highest = 0.5 / period
    return (*(edge for edge in EDGES_HZ if edge < highest), highest)


def band_powers(innovations: Array, period: float) -> Array:
    """Return the mean square of innovations in each frequency band, float64 (bands, outputs).

    The innovations are cut into segments of 1 s, or of 20 samples if these last longer. The
    segments overlap by half, under Hann's window. A shorter record is one segment.

    Args:
        innovations: (n, outputs), divided by their standard deviations; those that are not finite
            count as 0.
        period: sampling period, s.
    """
    length = min(max(round(_SEGMENT_S / period), _LEAST), len(innovations))
    window = np.hanning(length + 1)[:length]
    finite = np.nan_to_num(innovations, nan=0.0, posinf=0.0, neginf=0.0)
    starts = range(0, len(finite) - length + 1, max(length // 2, 1))
    power = np.zeros((length // 2 + 1, finite.shape[1]))
    for start in starts:
        part = finite[start : start + length] * window[:, None]
        power += np.abs(np.fft.rfft(part, axis=0)) ** 2
    power /= len(starts) * length * (window**2).sum()
    # Each frequency counts for its negative as well, except 0 and half the sampling rate.
    last = len(power) if length % 2 else len(power) - 1
    power[1:last] *= 2.0
    frequencies = np.fft.rfftfreq(length, period)
    ends = np.array(edges(period))
    band = np.clip(np.searchsorted(ends, frequencies, side="right") - 1, 0, len(ends) - 2)
    found = np.zeros((len(ends) - 1, finite.shape[1]))
    np.add.at(found, band, power)
    return found


def unheard(filtered: Filtered, twins: Sequence[Filtered], values: Values) -> float:
    """Return the part of the twins' cost that is noise which the recordings do not have.

    A sensor less noisy than stated, or whose readings were filtered, leaves innovations that are
    smaller than a twin's at high frequencies. What the model lacks, at low ones, is then hidden in
    the sum of all. Only channels whose highest band is short of noise (`OVERSTATED`) count, and of
    these all bands that are short of it.

    Args:
        filtered: the records, with gains for `values`.
        twins: twins of the model with these values, with gains for `values`.
        values: values of all parameters.

    Returns:
        Mean square in predicted variances per reading; 0 if the noise is not overstated.
    """
    heard = _powers(filtered, values)
    stated = np.mean([_powers(twin, values) for twin in twins], axis=0)
    short = stated > OVERSTATED * heard
    short &= short[-1]
    return float(np.sum((stated - heard)[short]) / filtered.samples)


def _powers(filtered: Filtered, values: Values) -> Array:
    """Return the sum of squares of each channel's innovations by band, (bands, outputs).

    It is the sum over all blocks if each block had the median power of all. The median is used
    because a twin may err more than the record in a few blocks, where a ram breaks away or comes on
    a stop.
    """
    period = filtered.predictor.plant.period
    powers, samples = [], 0
    for (innovations, _), blocks in zip(filtered.innovations(values), filtered.blocks, strict=True):
        powers += [band_powers(innovations[block], period) for block in blocks]
        samples += sum(block.stop - block.start for block in blocks)
    return np.asarray(np.median(powers, axis=0) * samples)
