"""This module measures noise that sensors are stated to have and that recordings do not have."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Array, band_powers

from .fit import Filtered
from .variables import Values

OVERSTATED: Final = 1.5
"""A band is short of noise if a twin has more than so many times its power. Chance changes the
median power of 16 blocks and more by a few per cent."""


def unheard(filtered: Filtered, twins: Sequence[Filtered], values: Values) -> float:
    """Return the part of the twins' cost that is noise which the recordings do not have.

    A sensor less noisy than stated, or whose readings were filtered, leaves innovations that are
    smaller than a twin's at high frequencies. What the model lacks, at low ones, is then hidden in
    the sum of all. A channel counts if its highest band is short of noise, with all bands that are.

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

    It is that of all blocks if each had the power of their median. Where a ram breaks away, or
    comes on a stop, a twin may err more than the record; such blocks are few.
    """
    period = filtered.predictor.plant.period
    powers, samples = [], 0
    for (innovations, _), blocks in zip(filtered.innovations(values), filtered.blocks, strict=True):
        powers += [band_powers(innovations[block], period) for block in blocks]
        samples += sum(block.stop - block.start for block in blocks)
    return np.asarray(np.median(powers, axis=0) * samples)
