"""The simulated rig: a plant with its transducers, in place of a connection to hardware.

Noise comes from a generator that the test seeds, and is drawn in order. So a run does not depend on
how its ticks are batched, nor on whether the clock paces it: the same seed gives the same recording
bit for bit.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.plant import (
    DATA_SHEET,
    READING_COUNT,
    Model,
    Parameters,
    SensorParameters,
    command_path,
    rest_state,
    start_clock,
    transducers,
)

from .correction import Corrections, corrections_of

Array = NDArray[np.float64]

_FLOW_METERS = 3


@dataclass
class SimulatedRig:
    """The true state of a plant and the memory of its transducers; the loop updates both in place.

    Attributes:
        parameters: the true parameters of this rig, SI.
        sensors: data sheet of its transducers.
        fitted: float64 (9,), 1 where the rig has the transducer of `rig.plant.sensors.Reading`,
            else NaN.
        state: float64 (9,), `rig.plant.dynamics.PlantState`.
        path: memory of what lies between command and plant (`rig.plant.command_effects`).
        seen: the transducers' memory (`rig.plant.transducer_effects`).
        meters: float64 (3,), flow-meter lag states in m^3/s.
        offsets: float64 (3,), the meters' fixed errors in m^3/s, drawn once.
        generator: source of all noise.
        corrections: calibrations of the transducers, by which the loop corrects their readings;
            without any unless they are set.
    """

    parameters: Parameters
    sensors: SensorParameters
    fitted: Array
    state: Array
    path: Array
    seen: Array
    meters: Array
    offsets: Array
    generator: np.random.Generator
    corrections: Corrections = field(default_factory=corrections_of)

    def noise(self, ticks: int) -> Array:
        """Return float64 (ticks, 9) standard normal numbers, one for each tick and transducer."""
        return self.generator.standard_normal((ticks, READING_COUNT))

    def noise_apart(self, ticks: int) -> Array:
        """Return float64 (ticks, 9) standard normal numbers that `noise` would not return.

        They are for ticks outside a test. A generator of their own, spawned from `generator`, draws
        them, so that the numbers of `noise` during the test stay the same.
        """
        return self.generator.spawn(1)[0].standard_normal((ticks, READING_COUNT))

    def start_clock(self, time_s: float) -> None:
        """Set the time of the next tick, s from the test's start; a supply ripple follows it."""
        start_clock(self.path, time_s)


def simulated_rig(
    model: Model,
    seed: int,
    *,
    sensors: SensorParameters = DATA_SHEET,
    spool_sensor: bool = True,
    supply_pressure_sensor: bool = True,
    load_cell: bool = True,
    position: float | None = None,
) -> SimulatedRig:
    """Return a simulated rig with its ram at rest.

    Args:
        model: the true model of the rig.
        seed: seed of all noise.
        sensors: data sheet of the rig's transducers.
        spool_sensor: whether the rig measures its spool.
        supply_pressure_sensor: whether it measures its supply pressure.
        load_cell: whether it measures the force on its rod.
        position: position of the ram, m; None for mid stroke.
    """
    par = model.parameters
    generator = np.random.default_rng(seed)
    fitted = np.ones(READING_COUNT)
    fitted[3:6] = np.where([spool_sensor, supply_pressure_sensor, load_cell], 1.0, np.nan)
    offsets = np.abs(sensors.flow_error * generator.standard_normal(_FLOW_METERS))
    middle = 0.5 * (par.stroke_min + par.stroke_max)
    state = rest_state(par, middle if position is None else position)
    return SimulatedRig(
        par, sensors, fitted, state, command_path(par), transducers(par, state),
        np.zeros(_FLOW_METERS), offsets, generator,
    )  # fmt: skip
