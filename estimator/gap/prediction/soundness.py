"""This module checks that a plant's states stay finite along a recording before any fit."""

import numpy as np

from estimator.gap.plant import Plant, PlantError, record_of
from rig.recording import Recording

from .predictor import Predictor


def check_course(recording: Recording, plant: Plant) -> None:
    """Check that the plant, with its own parameter values, has finite states along a recording.

    Raises:
        PlantError: a state or reading is not finite; the error says which, when, and what may be
            the cause.
        KeyError: the recording lacks a channel of the plant.
    """
    predictor, record = Predictor(plant), record_of(recording, plant)
    with np.errstate(all="ignore"):
        gains = predictor.filter(record, plant.nominal)
        innovations, states = predictor.innovations(record, gains, plant.nominal)
    finite = np.isfinite(states)
    if finite.all() and np.isfinite(innovations).all():
        return
    row = int(np.argmin(finite.all(axis=1) & np.isfinite(innovations).all(axis=1)))
    lost = np.flatnonzero(~finite[row])
    name = plant.states[int(lost[0])].name if len(lost) else "a reading"
    raise PlantError(
        [
            f"plant {plant.name}: {name} is {states[row, lost[0]] if len(lost) else 'not finite'} "
            f"at {row * plant.period:.3f} s of {recording.source}; rates must be finite wherever "
            "the plant comes, and what is fast needs more substeps (docs/another_plant.md)"
        ]
    )
