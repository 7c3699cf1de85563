"""What a rig shows while its ram is held: the valve's null, and the noise of each sensor."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.channels import READINGS

Array = NDArray[np.float64]

SETTLE_S: Final = 3.0
"""Time in s in which the ram comes to rest: ten time constants of the thesis's loop."""
LOOKED_S: Final = 5.0
"""Time in s over which noise is taken: 5000 samples tell it to 1 %, and 50 of a meter to 10 %."""
_NULL_S: Final = 2.0
NOISES: Final = {
    "pressure_1_Pa": "pressure_noise",
    "pressure_2_Pa": "pressure_noise",
    "supply_pressure_Pa": "supply_pressure_noise",
    "spool_m": "spool_noise",
    "load_N": "load_noise",
    "flow_1_m3_per_s": "flow_noise",
    "flow_2_m3_per_s": "flow_noise",
    "flow_internal_m3_per_s": "flow_noise",
}
"""Channel -> the key of the rig file's `sensors` that has its noise."""
LOOKED_AT: Final = ("command_V", *READINGS)
_FEWEST: Final = 10
"""Fewest differences from which noise is told."""
_AT_AN_END: Final = 0.1
"""Part of equal least or greatest samples from which on a channel stands at an end of its range,
where noise is cut off, as a load cell does that reads no less than 0."""
_OF_DIFFERENCES: Final = 1.2
"""Standard error of a deviation from differences in that of one from independent values: the square
root of 3/2, as neighbouring differences share a value (von Neumann and others 1941)."""


@dataclass(frozen=True)
class Noise:
    """The noise of a channel.

    Attributes:
        deviation: standard deviation from sample to sample, SI.
        error: its relative standard error.
    """

    deviation: float
    error: float


@dataclass(frozen=True)
class Standing:
    """What the rows of a held ram show.

    Attributes:
        null_V: mean command, V; NaN if there is none.
        noise: channel -> its noise, for the channels of which it can be told.
        silent: channels of the sensors that read nothing.
    """

    null_V: float  # noqa: N815
    noise: Mapping[str, Noise]
    silent: tuple[str, ...]


def standing_of(rows: Array, tick_s: float) -> Standing:
    """Return what rows of a held ram show.

    Noise is that of differences between values that follow each other, over the square root of 2,
    so that a slow drift does not count. Of a channel whose values stand for several ticks, such as
    a meter's, each value counts once.

    Args:
        rows: (ticks, len(LOOKED_AT)), SI.
        tick_s: time from row to row, s.
    """
    last = rows[-round(_NULL_S / tick_s) :, 0]
    columns = dict(zip(LOOKED_AT, rows.T, strict=True))
    found = {name: _noise(columns[name]) for name in NOISES}
    return Standing(
        float(np.mean(last[np.isfinite(last)])) if np.isfinite(last).any() else float("nan"),
        {name: noise for name, noise in found.items() if noise is not None},
        tuple(name for name in READINGS if not np.isfinite(columns[name]).any()),
    )


def _noise(values: Array) -> Noise | None:
    known = values[np.isfinite(values)]
    if known.size < _FEWEST:
        return None
    if max(np.mean(known == known.min()), np.mean(known == known.max())) > _AT_AN_END:
        return None
    new = known[np.concatenate([[True], np.diff(known) != 0.0])]
    if new.size <= _FEWEST:
        return None
    deviation = float(np.std(np.diff(new)) / np.sqrt(2.0))
    return Noise(deviation, _OF_DIFFERENCES / float(np.sqrt(2.0 * new.size)))
