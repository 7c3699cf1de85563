"""A few seconds in free simulation beside a recording: for the eye, never for a verdict.

Stick-slip makes two free runs with tiny differences part in phase, so that they prove nothing.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Record

from .predictor import Predictor
from .results import FreeRun
from .variables import Values

SECONDS: Final = 4.0
CHANNELS: Final = 3
"""Outputs drawn: the first of the plant."""


def free_runs(
    predictor: Predictor, records: Sequence[Record], before: Values, after: Values
) -> list[FreeRun]:
    """Return the first seconds of the first record, each channel beside both models.

    Both start from the readings, the ram at rest, as far as the model is told.
    """
    if not records:
        return []
    plant = predictor.plant
    whole = records[0]
    count = min(round(SECONDS / plant.period), len(whole))
    record = Record(
        whole.source,
        whole.inputs[:count],
        whole.readings[:count],
        whole.variances[:count],
        whole.first,
    )
    given = predictor.simulate(record, before, steered=False)[1]
    written = predictor.simulate(record, after, steered=False)[1]
    time_s = plant.period * (whole.first + np.arange(count, dtype=np.float64))
    return [
        FreeRun(
            record.source, time_s, output.channel, output.unit, output.shown or (output.unit, 1.0),
            np.where(np.isfinite(record.variances[:, k]), record.readings[:, k], np.nan),
            given[:, k], written[:, k],
        )
        for k, output in enumerate(plant.outputs[:CHANNELS])
    ]  # fmt: skip
