"""Records motions of the independent rig as arrays, and writes them as files for the product."""

import gzip
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tools.hidden_effects import physics
from tools.hidden_effects.motions import Motion
from tools.hidden_effects.rig_values import RigValues

PRESSURE_NOISE: Final = 3e4
"""Standard deviation of a pressure reading, Pa."""
SPOOL_NOISE: Final = 1e-6
"""Standard deviation of a spool reading, m."""
COLUMNS: Final = ("time_s", *physics.READINGS)

_SETTLING: Final = 1000
"""Rows for which the ram is held in closed loop before the recording begins."""
_HOLD: Final = 30.0
"""Gain of the position loop in these rows, V/m."""
_FORMATS: Final = ("%.3f", "%.6f", "%.6f", "%.1f", "%.1f", "%.4e")

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Recorded:
    """A recording and the true states of the rig.

    Attributes:
        table: (n, 6) time and readings, columns as in `COLUMNS`.
        truth: (n, 14) states at the same moments, columns as in `physics.STATES`.
    """

    table: Array
    truth: Array


def record(values: RigValues, motion: Motion, rng: Generator) -> Recorded:
    """Let a rig settle at the motion's first setpoint, then run the motion and record it.

    The ram starts at rest at this setpoint, or at the stroke end if the setpoint lies beyond it,
    and is held there for 1 s by the position loop, also if the motion is in open loop.

    Args:
        values: values of the rig.
        motion: what the rig is asked to do, of n rows.
        rng: draws the noise of the sensors and the random delays of the command.

    Returns:
        The recording, of n rows; the settling is not in it.
    """
    n = len(motion.setpoint)
    rows = n + _SETTLING
    begin = float(motion.setpoint[0])
    setpoint = np.concatenate([np.full(_SETTLING, begin), motion.setpoint])
    feed = np.concatenate([np.zeros(_SETTLING), motion.feed])
    gain = np.concatenate([np.full(_SETTLING, _HOLD), np.full(n, motion.gain)])
    noise = rng.normal(size=(rows, 3)) * (PRESSURE_NOISE, PRESSURE_NOISE, SPOOL_NOISE)
    readings, truth = physics.run(
        values, setpoint, feed, gain, 0, _SETTLING, noise, rng.random(rows),
        at_rest(values, min(max(begin, 1e-3), 0.605)), physics.STEPS,
    )  # fmt: skip
    time = np.arange(n)[:, None] * physics.TICK
    shown = _wired(values, np.hstack([time, readings[_SETTLING:]]))
    return Recorded(shown, truth[_SETTLING:])


def _wired(values: RigValues, table: Array) -> Array:
    """Return a table (n, 6) of readings with what the wires of the pressure channels do to them.

    These are a drifting zero, a tone, the command's crosstalk, a jump, mixed up and stuck channels.
    """
    time, command = table[:, 0], np.r_[0.0, table[:-1, 1]]
    tone = np.sin(2.0 * np.pi * values.tone_frequency * time + values.tone_phase)
    loose = time >= values.loose_at
    of_gauges = (
        (3, values.gauge_1_drift, values.tone_gauge_1, values.gauge_1_crosstalk,
         values.loose_gauge_1),
        (4, values.gauge_2_drift, values.tone_gauge_2, values.gauge_2_crosstalk,
         values.loose_gauge_2),
    )  # fmt: skip
    for column, drift, of_tone, crosstalk, jump in of_gauges:
        added = drift * time + of_tone * tone + crosstalk * command + jump * loose
        table[:, column] = np.maximum(0.0, table[:, column] + added)
    if values.swapped_gauges:
        table[:, [3, 4]] = table[:, [4, 3]]
    if values.stuck_reading and loose.any():
        column = 1 + int(values.stuck_reading)
        table[loose, column] = table[np.argmax(loose), column]
    return table


def at_rest(values: RigValues, position: float) -> Array:
    """Return the states (14,) of a ram at rest at `position` (m), columns as in `physics.STATES`.

    Both chambers have half the pump's pressure, the supply line all of it, and the tank line 0.
    """
    states = np.zeros(len(physics.STATES))
    states[physics.POSITION] = position
    states[[physics.P1, physics.P2, physics.POCKET]] = 0.5 * values.pump_pressure
    states[physics.SUPPLY] = values.pump_pressure
    return states


def write(table: Array, file: Path) -> None:
    """Write a table (n, 6) as gzip-compressed CSV; if writing is cut short, `file` stays as it was.

    The columns are those in `COLUMNS`. The folder is created if it is missing.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.name}.part")
    with gzip.open(part, "wt", compresslevel=3, encoding="ascii") as out:
        np.savetxt(out, table, fmt=_FORMATS, delimiter=",", header=",".join(COLUMNS), comments="")
    part.replace(file)
