"""The plant's motion from one moment to another, and samples of its transducers, compiled."""

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
    """Advance plant, transducers and flow meters in place, with constant command and faults.

    Args:
        state: float64 (9,), `rig.plant.dynamics.PlantState`.
        path: memory of what lies between command and plant (`rig.plant.command_effects`), without
            the delay.
        seen: the transducers' memory (`rig.plant.transducer_effects`).
        flows: float64 (3,), flow-meter lag states in m^3/s.
        command: command at the valve, V.
        par: the plant's `Parameters`.
        fault: float64 (8,), coefficients (`rig.plant.faults.FaultInput`).
        duration: any time in s; whole ticks are stepped as on the simulated backend, then the rest.
        flow_time_constant: time constant of the flow meters, s.
    """
    remaining = duration
    while remaining > 0.0:
        # A remainder that is only rounding must not become a step of its own.
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
        flows: float64 (3,), flow-meter lag states in m^3/s, which `advance_plant` advances.
        offsets: float64 (3,), the meters' fixed errors in m^3/s.
        noise: float64 (9,), standard normal numbers.
        par: the plant's `Parameters`.
        sensors: data sheet of the transducers.
        fitted: float64 (9,), 1 where the rig has the transducer, else NaN.
        sampled: float64 (9,), filled with the readings, NaN for transducers that the rig lacks.
    """
    load = spring_force(state[4], par)
    sample_sensors(state, seen, load, flows, offsets, noise, par, sensors, sampled)
    for i in range(sampled.size):
        sampled[i] *= fitted[i]


@njit(cache=True, error_model="numpy", nogil=True)
def shown_position(state: Array, seen: Array, par: Parameters) -> float:
    """Return the position in m that the encoder's scale shows, before it is rounded to counts.

    Args:
        state: float64 (9,), the true state, `rig.plant.dynamics.PlantState`.
        seen: the transducers' memory (`rig.plant.transducer_effects`).
        par: the plant's `Parameters`, with the gain of the scale.
    """
    return par.position_gain * seen_position(seen, state[4], par)
