"""Simulates the motions that the bound is computed for, with the nominal rig's true states."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from rig.plant import NO_FAULT, NOMINAL, Parameters
from rig.plant.dynamics import PlantState, rest_state
from rig.plant.integrator import TICK, advance
from tools.simulated.drawn_rigs import MIDDLE, multisine

Array = NDArray[np.float64]

SPRING: Final = 2e4
"""Stiffness of the thesis's soft spring (section 6.1), N/m; the ram meets it at 0.22 m."""
_STEP_S: Final = 2.0
_SEED: Final = 1


@dataclass(frozen=True)
class Course:
    """A motion of the nominal rig.

    Attributes:
        name: names of the motion and of the load.
        parameters: parameters of the rig.
        command: float64 (ticks,), V, held from each tick to the next.
        states: float64 (ticks, 9), true states in the order of `PlantState`, at each tick.
    """

    name: str
    parameters: Parameters
    command: Array
    states: Array


def setpoints(ticks: int) -> dict[str, Array]:
    """Return the setpoints in m, float64 (ticks,), by the name of their motion; always the same."""
    time_s = np.arange(ticks) * TICK
    rng = np.random.default_rng(_SEED)
    levels = rng.uniform(0.1, 0.5, int(time_s[-1] / _STEP_S) + 1)
    return {
        "sine, 0.1 m at 0.5 Hz": MIDDLE + 0.1 * np.sin(np.pi * time_s),
        "steps, one in 2 s": levels[(time_s / _STEP_S).astype(int)],
        "multisine, 0.12 m": multisine(rng, ticks),
    }


def courses(ticks: int) -> Iterator[Course]:
    """Yield the course of every motion in `setpoints`, first unloaded, then against a spring."""
    for load, stiffness in (("unloaded", 0.0), ("spring load", SPRING)):
        for name, setpoint in setpoints(ticks).items():
            rig = NOMINAL._replace(spring_stiffness=stiffness)
            yield follow(f"{name}, {load}", rig, setpoint)


def follow(name: str, parameters: Parameters, setpoint: Array) -> Course:
    """Return the course of a healthy rig whose position loop follows a setpoint (ticks,) in m.

    The ram begins at rest at the first setpoint. The loop is proportional, with `POSITION_GAIN` and
    commands up to `COMMAND_LIMIT`, and gets the true position without noise or delay.
    """
    state = rest_state(parameters, float(setpoint[0]))
    command = np.empty(setpoint.size)
    states = np.empty((setpoint.size, len(PlantState._fields)))
    fault = np.array(NO_FAULT)
    for k, wanted in enumerate(setpoint):
        states[k] = state
        error = float(wanted - state[4])
        command[k] = np.clip(POSITION_GAIN * error, -COMMAND_LIMIT, COMMAND_LIMIT)
        advance(state, command[k], parameters, fault)
    return Course(name, parameters, command, states)
