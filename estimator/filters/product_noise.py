"""What the product filter assumes of sensors and of its own errors, and what it holds possible.

Sensor variances and ranges follow the data sheets; the rest is a stated budget of model errors.
"""

from math import sqrt
from typing import Final, NamedTuple

from rig.plant import LITRE_PER_MINUTE, TICK, Parameters, SensorParameters, valve_conductance

DRY: Final = 1e5
"""Below this pressure (Pa) a chamber may hold a vapour cavity, whose volume no sensor sees: three
times the noise of a 20.7 MPa transducer."""

_ZERO_SHIFT: Final = 0.02
"""Part of a transducer's range by which its zero may be off: a reading lower than its least by the
vacuum and more than this is none."""
_VACUUM: Final = 1e5
_HEADROOM: Final = 1.5
"""Times the supply pressure that a chamber may reach when a load or the ram's momentum compresses
it."""
_FINEST: Final = 2.0**-16
"""Part of a transducer's range that is its least noise: no converter on such a rig resolves
more."""
_FULL_COMMAND: Final = 10.0
_NEGATIVE_LEAK: Final = 2.0 * LITRE_PER_MINUTE
"""Largest estimate of a leak of the wrong sign, m^3/s at half the supply pressure: some twice what
a stroke end feigns where the bulk modulus is wrong by 15 %."""
_NULL_BIAS: Final = 5e-5
"""m; the range of `Parameters.spool_null_bias`."""


class Ranges(NamedTuple):
    """What a reading can be (others are skipped), and what a state can be.

    A reading on its bound is a saturated one. States are kept within the bounds down to `leakage`;
    with one beyond the last two a filter is lost.
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
    """Noise the product filter assumes: variances of the sensors and a stated model-error budget.

    Process variances are per millisecond. `initial` are the standard deviations of P0.
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
    """Return the filter's noise variances for given sensors.

    The encoder's error is uniform over one count. The budget: the valve model is off by 2 um (white
    over its bandwidth), a chamber's flow by 0.1 L/min, the load moves by 150 N/ms (it carries the
    friction, which turns around within some 20 ms), a leak by 0.1 L/min at half supply pressure in
    a second, the spool's null by 0.02 um in a second.

    P0 takes the first samples to their noise, the null to 5 um, leaks to 0.02 L/min: a leak and a
    shifted null look alike at first, and what is there from the start is taken for the null.
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
    """Return the ranges: of position, the stroke and half of what the dead volumes add to it."""
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
