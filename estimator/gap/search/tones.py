"""This module selects tones, waves in time, that are worth an exact look.

A machine beside the rig, or the mains, keeps its frequency, but each recording begins at another
moment of its turn. So a tone has one frequency, and a phase of its own in each recording.

By how much a tone would lower the cost follows from two figures, to second order: the slope of the
cost by its sine and cosine, and the curvature. The slopes at all frequencies are the Fourier
transform of what `Attribution.pull` returns. The curvature at all frequencies follows from the
answer of the linearised course to one course of white noise.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from estimator.gap.plant import TIME_NAME, Array

from .disturbances import Attribution, Place
from .findings import CHANCE
from .shapes import Shape
from .spectra import curvature_of

_SLOWEST: Final = 3.0
"""Least number of periods of a tone in the shortest recording: fewer are a course of their own."""
_FASTEST: Final = 5.0
"""Least number of samples in a period."""
_FINER: Final = 4
"""Frequencies are tried at this part of 1 / the length of the longest recording."""
_BANDS_HZ: Final = (0.0, 2.0, 20.0, np.inf)
"""Hz. The best tone is selected in each of these bands, as the curvature is rougher at the slow
end, where a block of half a second has no whole period."""


def tones(
    attribution: Attribution, place: Place, times: Sequence[Array], least: float = CHANCE
) -> list[Shape]:
    """Return the tones at a place that promise the most, at most one in each of three bands.

    A tone must promise to lower the cost by `least`. It has a phase in each recording that the
    courses belong to, which is fitted later.

    Args:
        attribution: linearised courses, with what is to be explained.
        place: place where the tone enters.
        times: time at each sample of each course, (m,) each, s.
        least: least promise that is worth a look.
    """
    period = attribution.plant.period
    numbers = np.array(attribution.numbers)
    recordings = tuple(int(number) for number in np.unique(numbers))
    begins = [min(t[0] for t, n in zip(times, numbers, strict=True) if n == r) for r in recordings]
    ends = [max(t[-1] for t, n in zip(times, numbers, strict=True) if n == r) for r in recordings]
    lengths = np.array(ends) - np.array(begins)
    count = _FINER * round(float(lengths.max()) / period)
    frequencies = np.fft.rfftfreq(count, period)
    curvature = np.interp(frequencies, *curvature_of(attribution, place))
    gains = np.zeros(len(frequencies))
    pulls = attribution.pull(place)
    for begin, recording in zip(begins, recordings, strict=True):
        whole = np.zeros(count)
        for pull, time, number in zip(pulls, times, numbers, strict=True):
            if number == recording:
                np.add.at(whole, np.round((time - begin) / period).astype(np.int64), pull)
        samples = sum(len(t) for t, n in zip(times, numbers, strict=True) if n == recording)
        gains += np.abs(np.fft.rfft(whole)) ** 2 / (curvature * samples)
    slowest, most = _SLOWEST / float(lengths.min()), 1.0 / (_FASTEST * period)
    found = []
    for low, high in pairwise(_BANDS_HZ):
        inside = (frequencies >= max(low, slowest)) & (frequencies < min(high, most))
        if inside.any():
            best = int(np.argmax(np.where(inside, gains, -1.0)))
            if gains[best] < least:
                continue
            at = (float(1.0 / frequencies[best]),)
            found.append(Shape(TIME_NAME, "", "tone", at, recordings))
    return found
