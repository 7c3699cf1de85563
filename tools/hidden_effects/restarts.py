"""Compares the independent rig with recordings made elsewhere, over windows of 50 ms.

    python -m tools.hidden_effects.restarts FOLDER... [--effects JSON]   # each with *.csv.gz

Two free runs come out of phase wherever the ram sticks. Therefore the simulation starts anew from
the measurements every 100 ms and is compared with the recording for 50 ms. The states at the start
of such a window are fitted to it; the equations and the rig's values are not. Where the ram slides
at 0.03 to 0.1 m/s, friction falls with speed, and the smallest difference grows 25-fold in a
millisecond, so that no start can be fitted. Therefore the program prints medians over the windows,
and the share of windows whose residuals are within the noise.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tools.hidden_effects import physics
from tools.hidden_effects.menu import with_effects
from tools.hidden_effects.rig_values import TABLE, RigValues

EVERY: Final = 100
"""Rows from the start of one window to the next."""
WINDOW: Final = 50
"""Rows of a window."""
WITHIN: Final = 1.4
"""A window is followed if every channel's rms residual is below this, in units of its noise."""
SENSOR_NOISE: Final = {
    "position_m": physics.COUNT / np.sqrt(12.0),
    "pressure_1_Pa": 3e4,
    "pressure_2_Pa": 3e4,
    "spool_m": 1e-6,
}
"""Standard deviation of each reading, SI; an encoder's error is uniform over one count."""

_HISTORY: Final = 40
_FITTED: Final = (physics.POSITION, physics.SPEED, physics.BEND, physics.P1, physics.P2)
_NUDGE: Final = np.array([1e-6, 1e-5, 1e-7, 1e3, 1e3])
_ROUNDS: Final = 8

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Following:
    """The residuals between a recording and the simulated rig.

    Attributes:
        median: by channel, the median over all windows of the rms residual divided by the standard
            deviation of the sensor; a perfect simulation would have 1.
        followed: share of the windows in which this ratio is below `WITHIN` for all channels.
        windows: number of windows.
    """

    median: Mapping[str, float]
    followed: float
    windows: int


def _simulated(values: RigValues, command: Array, first: int, lead: int, states: Array) -> Array:
    n = len(command)
    quiet = np.zeros((n, 3))
    readings, truth = physics.run(
        values,
        np.zeros(n),
        command,
        np.zeros(n),
        first,
        lead,
        quiet,
        np.zeros(n),
        states,
        physics.STEPS,
    )
    readings[:, 1] = values.encoder_gain * truth[:, physics.POSITION]
    return np.asarray(readings[first:, 1:])


def _begun(rows: Array, at: int, free: Array, values: RigValues) -> Array:
    """Return the states (14,) at row `at`, from cubics fitted to the 25 measurements around it.

    The states of the spool and the lines are those of the free run, `free` (n, 14).
    """
    span = slice(max(0, at - 12), at + 13)
    time = (np.arange(len(rows))[span] - at) * physics.TICK
    states = free[at].copy()
    position = np.polyfit(time, rows[span, 1], 3)
    states[physics.POSITION], states[physics.SPEED] = position[-1], position[-2]
    for state, column, bias in (
        (physics.P1, 2, values.gauge_1_bias),
        (physics.P2, 3, values.gauge_2_bias),
    ):
        states[state] = np.polyfit(time, rows[span, column], 3)[-1] - bias
    push = values.ram_area * (states[physics.P1] - states[physics.P2]) - values.push_back
    held = push - values.drag * states[physics.SPEED]
    level = physics.slip_force(
        values,
        states[physics.POSITION],
        states[physics.SPEED],
        states[physics.P1],
        states[physics.P2],
    )
    states[physics.BEND] = np.clip(held, -level, level) / values.seal_stiffness
    return states


def _window(values: RigValues, rows: Array, at: int, free: Array) -> Array:
    """Return the residuals (WINDOW, 4) of the window from row `at` on, divided by the noise.

    The states at its start are fitted to position and pressures (Levenberg-Marquardt).
    """
    begin = max(0, at - _HISTORY)
    command = rows[begin : at + WINDOW, 0]
    measured = rows[at : at + WINDOW, 1:]
    noise = np.array(list(SENSOR_NOISE.values()))
    first = at - begin

    def residual(states: Array) -> Array:
        found = _simulated(values, command, first, first - at, states.copy())
        return np.asarray((measured - found) / noise)

    states = _begun(rows, at, free, values)
    best = residual(states)
    damping = 1e-3
    for _ in range(_ROUNDS):
        columns = []
        for state, nudge in zip(_FITTED, _NUDGE, strict=True):
            moved = states.copy()
            moved[state] += nudge
            columns.append((residual(moved) - best)[:, :3].ravel() / nudge)
        jacobian = np.stack(columns, axis=1)
        scale = np.sqrt((jacobian**2).sum(axis=0)) + 1e-300
        unit = jacobian / scale
        normal = unit.T @ unit + damping * np.eye(len(scale))
        step = np.linalg.solve(normal, -unit.T @ best[:, :3].ravel()) / scale
        tried = states.copy()
        tried[list(_FITTED)] += step
        found = residual(tried)
        if np.sum(found[:, :3] ** 2) < np.sum(best[:, :3] ** 2):
            states, best, damping = tried, found, damping * 0.2
        else:
            damping = max(damping, 1e-3) * 10.0
    return best


def following(values: RigValues, rows: Array, stride: int = 1) -> Following:
    """Simulate the windows of a recording and return the residuals.

    Windows begin every `EVERY` rows, the first one `EVERY` rows after the recording's start.

    Args:
        values: values of the simulated rig.
        rows: (n, 5) readings of the recording, see `physics.READINGS`.
        stride: only each `stride`-th window is simulated.

    Raises:
        ValueError: the recording is too short for a window.
    """
    n = len(rows)
    states = np.zeros(len(physics.STATES))
    states[physics.POSITION] = rows[0, 1]
    states[physics.P1], states[physics.P2] = rows[0, 2], rows[0, 3]
    states[physics.SUPPLY] = values.pump_pressure
    # Spool and lines hardly depend on the ram, so their states are taken from a free run.
    _, free = physics.run(
        values, np.zeros(n), rows[:, 0], np.zeros(n), 0, 0, np.zeros((n, 3)), np.zeros(n), states,
        physics.STEPS,
    )  # fmt: skip
    begins = range(EVERY, n - WINDOW, EVERY * stride)
    windows = [_window(values, rows, at, free) for at in begins]
    rms = np.sqrt(np.stack([np.mean(window**2, axis=0) for window in windows]))
    return Following(
        dict(zip(SENSOR_NOISE, np.median(rms, axis=0).tolist(), strict=True)),
        float(np.mean(rms.max(axis=1) < WITHIN)),
        len(windows),
    )


def read(file: Path) -> Array:
    """Return the readings (n, 5) of a CSV file, compressed or not, as in `physics.READINGS`.

    The file must have a head line and a first column with the time, which is left out.
    """
    return np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:]


def line(name: str, values: RigValues, file: Path, stride: int = 1) -> str:
    """Return a line of text on a recording: name, windows, medians by channel, share followed (%).

    The arguments are those of `following`; `name` begins the line.
    """
    found = following(values, read(file), stride)
    cells = "  ".join(f"{found.median[channel]:5.2f}" for channel in SENSOR_NOISE)
    return f"{name:28s} {found.windows:4d}   {cells}   {100.0 * found.followed:3.0f} %"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a line for each `*.csv.gz` in the given folders, simulated with the given effects."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.hidden_effects.restarts",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    example = '{"command_delay": {"value": 0.004}}'
    parser.add_argument(
        "--effects", type=json.loads, default={}, help=f"such as {example}; default none"
    )
    parser.add_argument("--stride", type=int, default=3, help="take one restart of; default 3")
    options = parser.parse_args(arguments)
    values = with_effects(TABLE, options.effects)
    print(f"{'':28s} windows    x     p1     p2   spool  within noise")
    for folder in options.folders:
        for file in sorted(folder.glob("*.csv.gz")):
            name = f"{folder.name}/{file.name[:-7]}"
            print(line(name, values, file, options.stride), flush=True)


if __name__ == "__main__":
    main()
