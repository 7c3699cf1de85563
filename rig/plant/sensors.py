"""The rig's transducers: what each reads of the true state, with noise, range and resolution."""

from math import exp, floor
from typing import Annotated, Final, NamedTuple

from numba import njit

from .compiled import inner
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


@inner
def _clipped(value, lower, upper):
    return min(max(value, lower), upper)


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

    The encoder counts whole increments; pressures saturate at the transducer's range and never read
    below an empty chamber; the meters lag, and see no direction (section 7.2.1).
    """
    counts = floor(state[4] / sensors.position_resolution + 0.5)
    reading[0] = counts * sensors.position_resolution
    for i in range(2):
        pressure = max(state[2 + i], 0.0) + sensors.pressure_noise * noise[1 + i]
        reading[1 + i] = _clipped(pressure, sensors.pressure_min, sensors.pressure_max)
    spool = state[0] + sensors.spool_noise * noise[3]
    reading[3] = _clipped(spool, -sensors.spool_range, sensors.spool_range)
    supply = state[7] + sensors.supply_pressure_noise * noise[4]
    reading[4] = _clipped(supply, sensors.pressure_min, sensors.pressure_max)
    reading[5] = _clipped(load + sensors.load_noise * noise[5], 0.0, sensors.load_max)
    kept = exp(-TICK / sensors.flow_time_constant)
    for i in range(3):
        meters[i] = kept * meters[i] + (1.0 - kept) * abs(leaks[i])
        reading[6 + i] = max(meters[i] + offsets[i] + sensors.flow_noise * noise[6 + i], 0.0)
