"""Makes records of rigs that equal the model, on a course that shows most effects."""

from collections.abc import Collection, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from estimator.gap.plant.interface import Plant
from estimator.gap.plant.records import Record, made_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model


def rig(effects: Collection[str] | None = None) -> Plant:
    """Return the servo actuator as a plant; with `effects`, it has only those of the catalogue."""
    plant = servo_actuator(Model())
    if effects is None:
        return plant
    return replace(plant, effects={name: plant.effects[name] for name in effects})


def recorded(
    plant: Plant, values: Mapping[str, float], seconds: float = 6.0, seed: int = 0
) -> Record:
    """Return the record of a rig with given parameters, which moves to and fro with rests.

    The rig is in closed loop. `values` are its parameters, and `seed` draws noise and phase.
    """
    time = np.arange(round(seconds * 1000)) * 1e-3
    phase = 0.3 * seed
    wave = 0.05 * np.sin(2.0 * time + phase) + 0.012 * np.sin(11.0 * time + phase)
    rest = np.sin(1.3 * time) > 0.9
    course = 0.3 + np.where(rest, np.round(wave, 2), wave)
    readings = np.column_stack([course, *np.full((2, len(time)), 6.9e6), np.zeros(len(time))])
    asked = made_of("course", np.zeros((len(time), 1)), readings, plant)
    # The position loop has 40 V/m, which is as soft as on real rigs.
    gentle = replace(plant, steering=((0, 0, 40.0),))
    return Predictor(gentle).twin(asked, values, seed)


@contextmanager
def fitter(plant: Plant, *records: Record) -> Iterator[Fitter]:
    """Yield a fitter of the records that computes in one thread."""
    with ThreadPoolExecutor(1) as pool:
        yield Fitter(Predictor(plant), records, pool)
