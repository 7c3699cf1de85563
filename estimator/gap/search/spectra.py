"""This module computes how much a disturbance of each frequency changes the cost.

That follows for all frequencies at once from the answer of the linearised course to one course of
white noise.
"""

from typing import Final

import numpy as np

from estimator.gap.plant import Array

from .disturbances import Attribution, Place

_SMOOTHED: Final = 5
"""Number of frequencies of a block that the curvature is averaged over."""
_SEED: Final = 1


def curvature_of(attribution: Attribution, place: Place) -> tuple[Array, Array]:
    """Return frequencies (n,), Hz, and the curvature of the cost by a tone at each, per sample.

    It is the mean square of what a tone of size one changes in the weighted innovations of a
    sample, summed over the readings: half of what white noise with a variance of one changes.

    Args:
        attribution: linearised courses.
        place: place where the tone enters.
    """
    generator = np.random.default_rng(_SEED)
    noise = [generator.standard_normal((len(c.samples), 1)) for c in attribution.courses]
    answers = attribution.in_blocks(place, noise)[..., 0]
    window = np.hanning(answers.shape[1])[:, None]
    powers = np.square(np.abs(np.fft.rfft(answers * window, axis=1))).mean(0).sum(1)
    powers /= float(np.square(window).sum())
    kernel = np.ones(_SMOOTHED) / _SMOOTHED
    smooth = np.convolve(np.pad(powers, _SMOOTHED // 2, mode="edge"), kernel, mode="valid")
    frequencies = np.asarray(np.fft.rfftfreq(answers.shape[1], attribution.plant.period))
    return frequencies, np.maximum(0.5 * smooth, 1e-12 * float(smooth.max()))
