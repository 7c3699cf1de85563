"""This module simulates a few seconds freely, to be seen beside a recording, never for a verdict.

With stick-slip, two free runs that differ by very little soon part in phase, so that they prove
nothing.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.gap.plant import Record

from .predictor import Predictor
from .results import FreeRun
from .variables import Values

SECONDS: Final = 4.0
"""Length of the free simulations, s."""
CHANNELS: Final = 3
"""Number of outputs that are drawn: the plant's first ones."""


def free_runs(
    predictor: Predictor, records: Sequence[Record], before: Values, after: Values
) -> list[FreeRun]:
    """Return, for each drawn channel, the first seconds of the first record beside both models.

    The plant's first `CHANNELS` outputs are drawn, over `SECONDS` or the whole record if it is
    shorter. Both models start from the state that `Plant.start` derives from the first readings,
    such as a ram at rest. From then on they get the commands alone.

    Args:
        predictor: predictor of the plant.
        records: only the first is used; without records the result is empty.
        before: values of all parameters in the model as given.
        after: values of all parameters in the model as written.
    """
    if not records:
        return []
    plant = predictor.plant
    whole = records[0]
    count = min(round(SECONDS / plant.period), len(whole))
    record = replace(
        whole,
        inputs=whole.inputs[:count],
        readings=whole.readings[:count],
        variances=whole.variances[:count],
        unread=None,
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
