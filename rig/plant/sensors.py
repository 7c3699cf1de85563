"""The rig's transducers: what each reads of the true state, with noise, range and resolution."""

from math import exp, floor
from typing import Annotated, Final, NamedTuple

from numba import njit

from .compiled import inlined
from .integrator import TICK
from .parameters import LITRE_PER_MINUTE
from .parameters import Quantity as _Quantity


class SensorParameters(NamedTuple):
    """Data-sheet figures of the transducers, SI; noise is one standard deviation of a sample."""

    position_resolution: Annotated[
        float, _Quantity("m", 1e-7, 1e-3, "", "section 2.1: 0.03 mm per count")
    ] = 3e-5
    pressure_noise: Annotated[
        float, _Quantity("Pa", 0.0, 1e6, "", "0.15 % of a 20.7 MPa transducer")
    ] = 3e4
    pressure_min: Annotated[float, _Quantity("Pa", -1e6, 1e6, "", "transducer range")] = 0.0
    pressure_max: Annotated[float, _Quantity("Pa", 1e6, 1e8, "", "transducer range")] = 2.07e7
    spool_noise: Annotated[float, _Quantity("m", 0.0, 1e-4, "", "valve LVDT")] = 1e-6
    spool_range: Annotated[float, _Quantity("m", 1e-5, 1e-2, "", "valve LVDT, both signs")] = 4e-4
    supply_pressure_noise: Annotated[
        float, _Quantity("Pa", 0.0, 1e6, "", "0.15 % of a 20.7 MPa transducer")
    ] = 3e4
    load_noise: Annotated[float, _Quantity("N", 0.0, 1e4, "", "0.1 % of a 22 kN cell")] = 22.0
    load_max: Annotated[float, _Quantity("N", 1e2, 1e6, "", "section 6.1: 0 to 22 kN")] = 2.2e4
    flow_error: Annotated[
        float, _Quantity("m^3/s", 0.0, 1e-4, "", "section 7.2: 0.05 to 0.1 L/min in healthy mode")
    ] = 0.075 * LITRE_PER_MINUTE
    flow_noise: Annotated[float, _Quantity("m^3/s", 0.0, 1e-4, "", "flow-meter ripple")] = (
        0.02 * LITRE_PER_MINUTE
    )
    flow_time_constant: Annotated[float, _Quantity("s", 1e-3, 10.0, "", "flow-meter lag")] = 0.1


DATA_SHEET: Final = SensorParameters()


class Reading(NamedTuple):
    """One sample of all transducers, SI; a sensor that the rig lacks reads NaN."""

    position: float
    pressure_1: float
    pressure_2: float
    spool: float
    supply_pressure: float
    load: float
    flow_1: float
    flow_2: float
    flow_internal: float


READING_COUNT: Final = len(Reading._fields)


@inlined
def encoder_position(position, sensors):
    """Return what the encoder reads in m: it counts whole increments."""
    counts = floor(position / sensors.position_resolution + 0.5)
    return counts * sensors.position_resolution


@inlined
def _clipped(value, lower, upper):
    return min(max(value, lower), upper)


@inlined
def pressure_reading(pressure, deviation, sensors):
    """Return what a transducer reads of a pressure in Pa, noisy by a `deviation` in Pa.

    It saturates at its range, and never sees below an empty chamber.
    """
    return _clipped(max(pressure, 0.0) + deviation, sensors.pressure_min, sensors.pressure_max)


@inlined
def spool_reading(spool, deviation, sensors):
    """Return what the valve's transducer reads of its spool in m, noisy by a `deviation` in m."""
    return _clipped(spool + deviation, -sensors.spool_range, sensors.spool_range)


@njit(cache=True, error_model="numpy", forceinline=True)
def read_sensors(state, leaks, load, meters, offsets, noise, sensors, reading):
    """Sample every transducer into `reading`.

    Args:
        state: float64 (9,), true state (`PlantState`).
        leaks: true leaks (from chamber 1, from chamber 2, from 1 to 2) in m^3/s.
        load: true spring force in N.
        meters: float64 (3,), flow-meter lag states in m^3/s, advanced in place by one tick.
        offsets: float64 (3,), the meters' fixed errors in m^3/s.
        noise: 9 standard normal numbers.
        sensors: `SensorParameters`.
        reading: float64 (9,), written in the order of `Reading`.

    The meters lag, and see no direction (section 7.2.1).
    """
    reading[0] = encoder_position(state[4], sensors)
    for i in range(2):
        deviation = sensors.pressure_noise * noise[1 + i]
        reading[1 + i] = pressure_reading(state[2 + i], deviation, sensors)
    reading[3] = spool_reading(state[0], sensors.spool_noise * noise[3], sensors)
    reading[4] = pressure_reading(state[7], sensors.supply_pressure_noise * noise[4], sensors)
    reading[5] = _clipped(load + sensors.load_noise * noise[5], 0.0, sensors.load_max)
    kept = exp(-TICK / sensors.flow_time_constant)
    for i in range(3):
        meters[i] = kept * meters[i] + (1.0 - kept) * abs(leaks[i])
        reading[6 + i] = max(meters[i] + offsets[i] + sensors.flow_noise * noise[6 + i], 0.0)
