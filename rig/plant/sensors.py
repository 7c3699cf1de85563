"""The rig's transducers: readings of the true state with noise, range and resolution."""

from math import exp, floor
from typing import Annotated, Final, NamedTuple

from rig.jit import njit

from .compiled import inlined
from .integrator import TICK
from .parameters import LITRE_PER_MINUTE, Quantity as _Quantity
from .transducer_effects import reading_means, seen_position, seen_pressures


class SensorParameters(NamedTuple):
    """Data-sheet values of the transducers, SI; noise is the standard deviation of a sample."""

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
    """One sample of all transducers, SI; NaN for a transducer that the rig lacks."""

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
    """Return the encoder's reading in m: the position rounded to a whole number of increments."""
    counts = floor(position / sensors.position_resolution + 0.5)
    return counts * sensors.position_resolution


@inlined
def _clipped(value, lower, upper):
    return min(max(value, lower), upper)


@inlined
def pressure_reading(shown, deviation, sensors):
    """Return a pressure transducer's reading in Pa: `shown` plus noise, limited to its range.

    Args:
        shown: pressure with the transducer's gain and bias, Pa.
        deviation: the noise of this sample, Pa.
        sensors: `SensorParameters`.
    """
    return _clipped(shown + deviation, sensors.pressure_min, sensors.pressure_max)


@inlined
def noisy_readings(shown, noise_1, noise_2, noise_spool, noise_supply, sensors):
    """Return the readings of position, pressures 1 and 2, spool and supply pressure, in SI.

    The position is only rounded to the encoder's resolution. The other four get noise, and are then
    limited to the ranges of their transducers.

    Args:
        shown: `Means`, the readings without noise, range and resolution.
        noise_1: standard normal number for the noise of pressure 1.
        noise_2: standard normal number for the noise of pressure 2.
        noise_spool: standard normal number for the noise of the spool.
        noise_supply: standard normal number for the noise of the supply pressure.
        sensors: `SensorParameters`.
    """
    deviation = sensors.supply_pressure_noise * noise_supply
    return (
        encoder_position(shown.position, sensors),
        pressure_reading(shown.pressure_1, sensors.pressure_noise * noise_1, sensors),
        pressure_reading(shown.pressure_2, sensors.pressure_noise * noise_2, sensors),
        _clipped(shown.spool + sensors.spool_noise * noise_spool, -sensors.spool_range,
                 sensors.spool_range),
        pressure_reading(shown.supply_pressure, deviation, sensors),
    )  # fmt: skip


@inlined
def follow_flows(meters, leaks, time_constant, step):
    """Advance the lag of the flow meters over a step, in which the leaks are constant.

    The meters read magnitudes only, without direction (section 7.2.1).

    Args:
        meters: float64 (3,), the meters' lag states in m^3/s, advanced in place.
        leaks: true leaks (from chamber 1, from chamber 2, from 1 to 2) in m^3/s.
        time_constant: time constant of the meters, s.
        step: length of the step, s.
    """
    kept = exp(-step / time_constant)
    for i in range(3):
        meters[i] = kept * meters[i] + (1.0 - kept) * abs(leaks[i])


@inlined
def sample_sensors(state, seen, load, meters, offsets, noise, par, sensors, reading):
    """Sample every transducer once and write the readings to `reading`; advance nothing.

    The arguments are as in `read_sensors`, but the caller has advanced the flow meters' lag in
    `meters`, and `load` is the true spring force in N.
    """
    p1, p2 = seen_pressures(seen, state[2], state[3], par)
    shown = reading_means(seen_position(seen, state[4], par), p1, p2, state[0], state[7], par)
    reading[0], reading[1], reading[2], reading[3], reading[4] = noisy_readings(
        shown, noise[1], noise[2], noise[3], noise[4], sensors
    )
    reading[5] = _clipped(load + sensors.load_noise * noise[5], 0.0, sensors.load_max)
    for i in range(3):
        reading[6 + i] = max(meters[i] + offsets[i] + sensors.flow_noise * noise[6 + i], 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def read_sensors(state, seen, leaks, load, meters, offsets, noise, par, sensors, reading):
    """Advance the flow meters by a tick, sample every transducer, and write the readings.

    Args:
        state: float64 (9,), true state (`PlantState`).
        seen: float64 (`TRANSDUCERS_SIZE`,), the transducers' memory, which the caller has brought
            up to `state` (`rig.plant.transducer_effects.follow`).
        leaks: true leaks (from chamber 1, from chamber 2, from 1 to 2) in m^3/s.
        load: true spring force in N.
        meters: float64 (3,), flow-meter lag states in m^3/s, advanced in place by one tick.
        offsets: float64 (3,), constant errors of the meters in m^3/s.
        noise: 9 standard normal numbers, in the order of `Reading`; the first is not used.
        par: `Parameters`, with the transducers' gains and biases.
        sensors: `SensorParameters`.
        reading: float64 (9,), written in the order of `Reading`.
    """
    follow_flows(meters, leaks, sensors.flow_time_constant, TICK)
    sample_sensors(state, seen, load, meters, offsets, noise, par, sensors, reading)
