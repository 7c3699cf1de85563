"""The tolerances of the plausibility checks, from data sheets and a stated false-alarm rate.

Derivations are in docs/safety.md. A threshold that noise could cross follows from `YEARS_BETWEEN`;
one that an error of the model could cross follows from the tolerances that the detector allows the
same model.
"""

from collections.abc import Iterable
from math import ceil, inf, log, sqrt
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT
from rig.channels import ENDS
from rig.io import FAST_INPUTS, HomingSettings, TransducerCalibration
from rig.plant import Parameters, SensorParameters, total_mass, valve_conductance

YEARS_BETWEEN: Final = 10.0
"""Years of uninterrupted ticks in which noise makes all checks together trip falsely once."""

_NOISY_CHECKS: Final = 12
"""Number of comparisons in a tick that noise could trip, among which false trips are shared."""
_REPEAT_CHANCE: Final = 0.5
"""Greatest chance that a healthy sample equals the last one: half of all do if clipped at zero."""
_SPEED_MARGIN: Final = 2.0
_NULL_TOLERANCE: Final = 1.3e-5
"""Tolerance of the spool's null in m: bias 10 um and overlap 3 um, as in docs/detection.md."""


class Tolerances(NamedTuple):
    """The tolerances with which the checks compare, SI; compiled code takes this tuple."""

    period_s: float
    """Period of the loop."""
    stale_ticks: int
    """Greatest age of a sample, in ticks."""
    required: NDArray[np.int64]
    """In the order of `FAST_INPUTS`: 1 where every fresh sample must have a value, else 0."""
    range_low: NDArray[np.float64]
    """In the order of `FAST_INPUTS`: low end of the range, at which a value is bad; -inf: none."""
    range_high: NDArray[np.float64]
    """In the order of `FAST_INPUTS`: high end of the range, at which a value is bad; inf: none."""
    frozen_samples: NDArray[np.int64]
    """In the order of `FAST_INPUTS`: number of equal samples in a row that are bad; 0: none is."""
    count_m: float
    """Resolution of the encoder, one count."""
    jump_speed_m_per_s: float
    """Speed beyond which the encoder has jumped, since the valve cannot move the ram so fast."""
    work_J: float  # noqa: N815
    """Energy that the ram may give back: four times its greatest kinetic energy."""
    above_supply_Pa: float  # noqa: N815
    """Excess over the supply pressure beyond which a chamber pressure counts as above it."""
    above_supply_ticks: int
    """Number of ticks above the supply pressure that are allowed without a break."""
    spool_m: float
    """Distance of the spool from the nominal valve's that is always allowed."""
    spool_ticks: int
    """Number of ticks beyond that distance that are allowed without a break."""
    command_V: float  # noqa: N815
    """Difference between valve output and command that errors of converters explain."""
    confirm_ticks: int
    """Number of ticks within which the device must confirm what it was sent."""
    unhomed_command_V: float  # noqa: N815
    """Greatest command above null, of either sign, for a ram that is not homed."""
    unhomed_load_pressure_Pa: float  # noqa: N815
    """Greatest load pressure of either sign for a ram that is not homed."""
    conductance: float
    """Conductance of the nominal valve, m^2/(s Pa^0.5) (eq. 2.1)."""
    par: Parameters
    """The nominal plant."""
    null_V: float = 0.0  # noqa: N815
    """Command at which the valve is closed, as far as the control knows it."""
    null_m: float = _NULL_TOLERANCE
    """Error that the spool's opening may have."""
    flow_fraction: float = 0.2
    """Error that the valve's flow may have, as a fraction of the flow: discharge coefficient 5 %,
    edges 2 %, supply 5 %, and what the nominal law leaves out."""
    leak_coefficient: float = 2.6e-8
    """Greatest crossport leak that a shipped rig injects, m^3/(s Pa^0.5)."""
    return_restriction: float = 4e13
    """Greatest blockage that the return throttle of a shipped rig makes, Pa/(m^3/s)^2."""
    flow_account_m: float = 5e-3
    """Travel that the valve's flow, with its tolerances, may leave unexplained."""
    pressure_bias_Pa: float = 1e5  # noqa: N815
    """Bias that the pressure transducers may have, as in docs/detection.md."""
    spool_fraction: float = 0.15
    """Distance of the spool from the nominal valve's that is allowed beside `spool_m`, as a part of
    the nominal spool's opening."""
    spool_lag_s: float = 4e-3
    """Time in which the nominal spool, at its present speed, goes a further distance allowed."""


def false_alarm_chance(period_s: float) -> float:
    """Return the chance of a false trip that a single comparison in one tick may have.

    With it, all comparisons together trip falsely once in `YEARS_BETWEEN` years.
    """
    return period_s / (YEARS_BETWEEN * 365.25 * 86400.0) / _NOISY_CHECKS


def sigmas(period_s: float) -> float:
    """Return the number of standard deviations that a comparison must allow for normal noise.

    Noise exceeds it on one side with the chance `false_alarm_chance`.
    """
    return -NormalDist().inv_cdf(false_alarm_chance(period_s))


def frozen_samples(period_s: float) -> int:
    """Return the number of equal samples in a row from which on a transducer counts as frozen.

    A healthy transducer, whose converter is finer than its noise, shows so many with a chance of
    `false_alarm_chance` at most.
    """
    return ceil(log(false_alarm_chance(period_s)) / log(_REPEAT_CHANCE))


def locked_tolerances(usual: Tolerances) -> Tolerances:
    """Return the tolerances of a cylinder that blocking valves may lock.

    They let pass all of the servovalve's flow, or none of it, or any part: the travel may be
    anything from standing still to what the usual tolerances allow. So a ram that moves against the
    flow, or faster than it, is still found.
    """
    return usual._replace(flow_fraction=1.0)


def tolerances(
    par: Parameters,
    sensors: SensorParameters,
    fitted: frozenset[str],
    period_s: float,
    stale_s: float,
    homing: HomingSettings,
    command_limit_V: float = COMMAND_LIMIT,  # noqa: N803
    calibrations: Iterable[TransducerCalibration] = (),
) -> Tolerances:
    """Return the tolerances with which the samples of a rig are checked.

    Args:
        par: parameters of the nominal plant, not the true ones of a simulated rig.
        sensors: data sheets of the transducers.
        fitted: channels of `FAST_INPUTS` that the fast driver supplies, which must have values.
        period_s: period of the loop, s.
        stale_s: greatest age of a sample, s.
        homing: gives the greatest command and load pressure of a ram that is not homed.
        command_limit_V: greatest command of either sign, V.
        calibrations: calibrations by which readings are corrected, and so the ends of their ranges.
    """
    deviation = sigmas(period_s)
    # An empty chamber reads the low end of its range; only beyond it is a transducer broken.
    span = sensors.pressure_max - sensors.pressure_min
    pressures = (sensors.pressure_min - 0.05 * span, sensors.pressure_max)
    # Channel -> its noise and the ends of its range.
    known = {name: (0.0, *ends) for name, ends in ENDS.items()} | {
        "pressure_1_Pa": (sensors.pressure_noise, *pressures),
        "pressure_2_Pa": (sensors.pressure_noise, *pressures),
        "supply_pressure_Pa": (sensors.supply_pressure_noise, *pressures),
        "spool_m": (sensors.spool_noise, -sensors.spool_range, sensors.spool_range),
        "load_N": (sensors.load_noise, -inf, sensors.load_max),
    }
    for each in calibrations:
        noise, low, high = known.get(each.channel, (0.0, -inf, inf))
        known[each.channel] = noise, each.corrected(low), each.corrected(high)
    sheets = [known.get(name, (0.0, -inf, inf)) for name in FAST_INPUTS]
    repeats = frozen_samples(period_s)
    conductance = valve_conductance(par)
    drop = par.supply_pressure - par.return_pressure
    # One port takes the whole supply pressure, which is more than in any real motion (eq. 2.1).
    speed = conductance * par.valve_gain * command_limit_V * sqrt(drop) / par.piston_area

    def ticks(seconds: float) -> int:
        return max(ceil(seconds / period_s), 1)

    return Tolerances(
        period_s=period_s,
        stale_ticks=ticks(stale_s),
        required=np.array([int(name in fitted) for name in FAST_INPUTS], np.int64),
        range_low=np.array([low for _, low, _ in sheets]),
        range_high=np.array([high for _, _, high in sheets]),
        frozen_samples=np.array(
            [repeats if noise > 0.0 else 0 for noise, _, _ in sheets], np.int64
        ),
        count_m=sensors.position_resolution,
        jump_speed_m_per_s=_SPEED_MARGIN * speed,
        work_J=2.0 * total_mass(par) * speed**2,
        above_supply_Pa=2e6
        + deviation * sqrt(sensors.pressure_noise**2 + sensors.supply_pressure_noise**2),
        above_supply_ticks=ticks(0.05),
        spool_m=_NULL_TOLERANCE + deviation * sensors.spool_noise,
        spool_ticks=ticks(0.025),
        command_V=0.01 * command_limit_V,
        confirm_ticks=ticks(0.02),
        unhomed_command_V=homing.command,
        unhomed_load_pressure_Pa=homing.load_pressure,
        conductance=conductance,
        par=par,
    )
