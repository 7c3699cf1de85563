"""This module finds two channels of a recording that were mixed up."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Record

from .fit import Fitter

MIXED_UP: Final = 4.0
"""Least number of times by which the cost of all predictions must fall when two channels are
exchanged: a model that is wrong by an effect costs more with right channels than with wrong ones by
no such factor, as half of all that it predicts is then wrong."""


def mixed_up(fitter: Fitter) -> list[str]:
    """Return in words which channels of the same unit were mixed up; empty if none were.

    The model as given predicts the records once as they are and once with two channels exchanged,
    each time with gains of its own.
    """
    plant = fitter.predictor.plant
    whole = range(len(plant.outputs))
    recorded = [k for k in whole if not any(r.lacks(k) for r in fitter.records)]
    pairs = [
        (one, other)
        for one, other in combinations(recorded, 2)
        if plant.outputs[one].unit == plant.outputs[other].unit
    ]
    if not pairs:
        return []
    given = _cost(fitter)
    found = []
    for one, other in pairs:
        order = [{one: other, other: one}.get(k, k) for k in whole]
        changed = [_exchanged(record, order) for record in fitter.records]
        cost = _cost(Fitter(fitter.predictor, changed, fitter.pool))
        if np.isfinite(cost) and not given < MIXED_UP * cost:
            names = " and ".join(plant.outputs[k].channel for k in (one, other))
            found.append(
                f"{names} are mixed up: with the two exchanged the model as given predicts "
                f"{given / cost:.0f} times better; exchange the columns, or the lines at the rig"
            )
    return found


def _cost(fitter: Fitter) -> float:
    """Return the cost per reading of the model as given; infinite if no reading can be used."""
    values = fitter.predictor.plant.nominal
    filtered = fitter.filtered(values)
    return float(filtered.costs(values).sum() / filtered.samples) if filtered.samples else np.inf


def _exchanged(record: Record, order: Sequence[int]) -> Record:
    """Return a record with its channels in another order."""

    def moved(columns: Array) -> Array:
        return np.ascontiguousarray(columns[:, order])

    return replace(
        record,
        readings=moved(record.readings),
        variances=moved(record.variances),
        unread=None if record.unread is None else np.ascontiguousarray(record.unread[:, order]),
    )
