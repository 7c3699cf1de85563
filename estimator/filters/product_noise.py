"""The noise that the product filter assumes, and the ranges to which it limits readings and states.

Sensor variances and ranges follow the data sheets; the rest is a stated budget of model errors.
"""

from math import sqrt
from typing import Final, NamedTuple

from rig.plant import LITRE_PER_MINUTE, TICK, Parameters, SensorParameters, valve_conductance

DRY: Final = 1e5
"""Pressure in Pa below which a chamber may hold a vapour cavity, whose volume no sensor measures.

It is three times the noise of a 20.7 MPa transducer."""

_ZERO_SHIFT: Final = 0.02
"""Part of a transducer's range by which its zero may be off. A reading that is below the least one
by more than a vacuum and this shift is skipped."""
_VACUUM: Final = 1e5
_HEADROOM: Final = 1.5
"""Greatest pressure of a chamber as a multiple of the supply pressure, when a load or the ram's
momentum compresses the oil."""
_FINEST: Final = 2.0**-16
"""Least noise of a transducer as a part of its range, the resolution of the best converter on such
a rig."""
_FULL_COMMAND: Final = 10.0
_NEGATIVE_LEAK: Final = 2.0 * LITRE_PER_MINUTE
"""Greatest estimate of a leak of negative sign, m^3/s at half the supply pressure. It is some twice
the estimate that a stroke end causes if the bulk modulus is wrong by 15 %."""
_NULL_BIAS: Final = 5e-5
"""Greatest null bias of a spool, m: the range of `Parameters.spool_null_bias`."""


class Ranges(NamedTuple):
    """Bounds of readings and states, SI units.

    The fields `position_min` to `spool` are bounds of readings: a reading on its bound (saturated)
    or beyond is skipped. `product.confine` limits states by the position's bounds, `pressure_max`
    and the fields `opening` (spool and null bias) to `leakage`, some of them times 2 or 4. A filter
    with a leak coefficient of -`negative_leakage` or less, or with a null bias of `null_bias` or
    more in either direction, is lost.
    """

    position_min: float
    position_max: float
    pressure_min: float
    pressure_max: float
    spool: float
    opening: float
    velocity: float
    load: float
    leakage: float
    negative_leakage: float
    null_bias: float


class ProductNoise(NamedTuple):
    """Noise that the product filter assumes, as variances in SI units squared.

    The fields `position`, `pressure` and `spool` are variances of the sensors. Those from
    `spool_velocity` to `null_bias` are process variances per millisecond, by a stated budget of
    model errors. `initial` holds standard deviations, not variances, of the states at the start.
    """

    position: float
    pressure: float
    spool: float
    spool_velocity: float
    chamber_pressure: float
    velocity: float
    load: float
    leakage: float
    null_bias: float
    initial: tuple[float, float, float, float, float, float, float, float, float, float, float]
    ranges: Ranges


def product_noise(sensors: SensorParameters, parameters: Parameters) -> ProductNoise:
    """Return the noise variances and ranges that the product filter assumes for given sensors.

    The encoder's error is uniform over one count. The budget of model errors: the valve model is
    off by 2 um (white over its bandwidth) and a chamber's flow by 0.1 L/min. The load changes by
    150 N/ms, as it includes friction, which reverses within some 20 ms. In a second a leak changes
    by 0.1 L/min at half supply pressure, and the spool's null by 0.02 um.

    At the start, measured states have the noise of the first sample, the null 5 um and leaks
    0.02 L/min. A leak and a shifted null look alike at first; this choice lets the filter explain
    a difference that is there from the start by the null.
    """
    half_supply = 0.5 * parameters.supply_pressure
    spool_acceleration = 2e-6 * parameters.valve_natural_frequency**2
    middle = 0.5 * (parameters.stroke_max - parameters.stroke_min)
    volume = parameters.line_volume_1 + parameters.piston_area * middle
    flow = 0.1 * LITRE_PER_MINUTE
    leak = 0.02 * LITRE_PER_MINUTE / sqrt(half_supply)
    pressure = max(sensors.pressure_noise, _FINEST * (sensors.pressure_max - sensors.pressure_min))
    return ProductNoise(
        position=sensors.position_resolution**2 / 12.0,
        pressure=pressure**2,
        spool=max(sensors.spool_noise, _FINEST * sensors.spool_range) ** 2,
        spool_velocity=(spool_acceleration * TICK) ** 2,
        chamber_pressure=(parameters.bulk_modulus / volume * flow * TICK) ** 2,
        velocity=1e-8,
        load=150.0**2,
        leakage=(flow / sqrt(half_supply)) ** 2 * TICK,
        null_bias=(2e-8) ** 2 * TICK,
        initial=(2e-6, 5e4, 5e4, 2e-5, 0.05, 1e-2, 500.0, leak, leak, leak, 5e-6),
        ranges=_ranges(sensors, parameters),
    )


def _ranges(sensors: SensorParameters, parameters: Parameters) -> Ranges:
    """Return the ranges of readings and states that fit a rig's sensors and parameters.

    The position may exceed the stroke at each end by half the length of the dead volume there.
    """
    highest = max(sensors.pressure_max, _HEADROOM * parameters.supply_pressure)
    span = sensors.pressure_max - sensors.pressure_min
    opening = max(2.0 * sensors.spool_range, _HEADROOM * parameters.valve_gain * _FULL_COMMAND)
    conductance = valve_conductance(parameters)
    area = parameters.piston_area
    return Ranges(
        position_min=parameters.stroke_min - 0.5 * parameters.line_volume_1 / area,
        position_max=parameters.stroke_max + 0.5 * parameters.line_volume_2 / area,
        pressure_min=sensors.pressure_min - _VACUUM - _ZERO_SHIFT * span,
        pressure_max=highest,
        spool=sensors.spool_range,
        opening=opening,
        velocity=conductance * opening * sqrt(highest) / area,
        load=area * highest,
        leakage=conductance * opening,
        negative_leakage=_NEGATIVE_LEAK / sqrt(0.5 * parameters.supply_pressure),
        null_bias=_NULL_BIAS,
    )
