"""This module estimates how large an error the model makes from sample to sample.

The greater the error that a model is said to make, the more the filter follows the readings, and
the less an effect shows. The likelihood of the innovations (Ljung 1999, ch. 7) is greatest where
they are as large as the filter expects. The estimate also contains whatever the model lacks: it is
an upper bound for the error to state, and a good one once nothing is missing any more.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.gap.plant import Plant, record_of
from rig.recording import Recording

from .linear import slices_of
from .predictor import Predictor
from .suitability import usable
from .variables import Values

SHARES: Final = tuple(float(share) for share in 2.0 ** np.arange(-8.0, 8.5, 1.0))
"""Factors on the stated model error that are tried."""


def likely_model_error(
    recordings: Sequence[Recording], plant: Plant, values: Values | None = None
) -> tuple[float, tuple[float, ...]]:
    """Return the factor on the plant's stated model error that makes the recordings likeliest.

    Args:
        recordings: recordings at 1 kHz, with the plant's channels.
        plant: plant whose states' noise is scaled.
        values: values of all parameters; None for the model's. Those of a fit are better.

    Returns:
        The factor, which is one of SHARES, and the log-likelihood for each of SHARES, up to a
        constant; -inf where it is not finite. If the factor is the first or last of SHARES, the
        best one may lie beyond.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
    used = plant.nominal if values is None else values
    likelihoods = tuple(_likelihood(recordings, plant, used, share) for share in SHARES)
    return SHARES[int(np.argmax(likelihoods))], likelihoods


def _likelihood(
    recordings: Sequence[Recording], plant: Plant, values: Values, share: float
) -> float:
    states = tuple(replace(state, noise=share * state.noise) for state in plant.states)
    predictor = Predictor(replace(plant, states=states))
    total = 0.0
    for record in usable([record_of(recording, plant) for recording in recordings], plant):
        gains = predictor.filter(record, values)
        innovations = predictor.innovations(record, gains, values)[0]
        for block in slices_of(record, plant.period):
            variances = gains.variances[block]
            used = np.isfinite(variances)
            total -= 0.5 * float(np.sum(np.log(variances[used]) + innovations[block][used] ** 2))
    return total if np.isfinite(total) else -np.inf
