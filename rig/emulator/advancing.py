"""The plant's motion between two looks at it, and what a look sees, compiled."""

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import (
    SUBSTEPS,
    TICK,
    Parameters,
    SensorParameters,
    drive_undelayed,
    follow,
    follow_flows,
    open_leaks,
    sample_sensors,
    seen_position,
    spring_force,
)

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", nogil=True)
def advance_plant(
    state: Array,
    path: Array,
    seen: Array,
    flows: Array,
    command: float,
    par: Parameters,
    fault: Array,
    duration: float,
    flow_time_constant: float,
) -> None:
    """Advance plant, transducers and flow meters in place over any time, command and faults held.

    Args:
        state: float64 (9,), `rig.plant.dynamics.PlantState`.
        path: between command and plant (`rig.plant.command_effects`), but for the delay.
        seen: the transducers' memory (`rig.plant.transducer_effects`).
        flows: float64 (3,), flow-meter lag states in m^3/s.
        command: what the valve is driven by, V.
        par: the plant's `Parameters`.
        fault: float64 (8,), coefficients (`rig.plant.faults.FaultInput`).
        duration: s; whole ticks are stepped as the simulated backend steps them, then the rest.
        flow_time_constant: of the flow meters, s.
    """
    remaining = duration
    while remaining > 0.0:
        # A rest of rounding is no step of its own.
        step = TICK if remaining > 1.000001 * TICK else remaining
        follow_flows(flows, open_leaks(state, par, fault), flow_time_constant, step)
        drive_undelayed(state, path, command, par, fault, step, SUBSTEPS)
        follow(seen, state, par, step)
        remaining -= step


@njit(cache=True, error_model="numpy", nogil=True)
def sample_plant(
    state: Array,
    seen: Array,
    flows: Array,
    offsets: Array,
    noise: Array,
    par: Parameters,
    sensors: SensorParameters,
    fitted: Array,
    sampled: Array,
) -> None:
    """Sample every transducer into `sampled`, float64 (9,) in the order of `Reading`.

    Args:
        state: float64 (9,), `rig.plant.dynamics.PlantState`.
        seen: the transducers' memory (`rig.plant.transducer_effects`).
        flows: float64 (3,), flow-meter lag states in m^3/s, which `advance_plant` moves.
        offsets: float64 (3,), the meters' fixed errors in m^3/s.
        noise: 9 standard normal numbers.
        par: the plant's `Parameters`.
        sensors: data sheet.
        fitted: float64 (9,), 1 where the rig has the transducer, else NaN.
        sampled: written.
    """
    load = spring_force(state[4], par)
    sample_sensors(state, seen, load, flows, offsets, noise, par, sensors, sampled)
    for i in range(sampled.size):
        sampled[i] *= fitted[i]


@njit(cache=True, error_model="numpy", nogil=True)
def shown_position(state: Array, seen: Array, par: Parameters) -> float:
    """Return the position in m that the encoder counts, of the true `state` (9,)."""
    return par.position_gain * seen_position(seen, state[4], par)
