"""This module reports channels that are stuck in a recording as discovered disturbances."""

from collections.abc import Sequence

import numpy as np

from estimator.gap.plant import Plant, Stuck, stuck_stretches
from estimator.gap.prediction import Discovered
from rig.recording import Recording

from .lexicon import LEXICON, likely_parts
from .sentences import unit_of

_NAME = "stuck_channel"


def stuck_channels(recordings: Sequence[Recording], plant: Plant) -> list[Discovered]:
    """Return each channel that is stuck in any of the recordings, in the order of the outputs.

    The filter leaves out what such a channel repeats, so that the model written has no part of it
    and no gap is computed from it.

    Raises:
        KeyError: a recording lacks a channel of the plant.
    """
    stretches = [each for recording in recordings for each in stuck_stretches(recording, plant)]
    return [
        _described(index, [each for each in stretches if each.output == index], plant)
        for index in sorted({each.output for each in stretches})
    ]


def _described(index: int, stretches: Sequence[Stuck], plant: Plant) -> Discovered:
    """Return one channel's stretches as a disturbance of its reading."""
    output = plant.outputs[index]
    place = f"reading of {output.channel}"
    unit, factor = unit_of(place, plant)
    times = [
        f"{each.value * factor:.4g} {unit} from {each.first * plant.period:.3g} s to "
        f"{each.end * plant.period:.3g} s of {each.source}"
        for each in stretches
    ]
    none = np.empty(0)
    return Discovered(
        _NAME, place, "", "", _NAME,
        f"The reading of {output.channel} repeats one value, which its noise would not let it do: "
        f"{'; '.join(times)}. These readings are left out of every fit and every gap",
        likely_parts(_NAME, place, plant), (), none, none, none, output.unit, "",
        float("nan"), float("nan"), float("nan"),
        in_model=False, experiment=LEXICON[_NAME].experiment,
    )  # fmt: skip
