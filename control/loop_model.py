"""What a model says of the position loop: its speed for a volt, its lag, and its feedforward.

Nothing here is compiled, so that checking a campaign need not wait for the compiler.
"""

from math import pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK, Parameters, SensorParameters

from .setpoints import Multisine, Setpoint, Sine
from .settings import ControlSettings

Array = NDArray[np.float64]

MOST_TONES: Final = 16
"""Greatest number of frequencies of a setpoint that are corrected, the lowest ones. Each costs a
sine and a cosine twice in every tick, so that all of them stay below 1 us."""
_HARMONICS: Final = (1, 2, 3)
LEAST_ROOT: Final = 0.05
"""Least part of the supply pressure that is assumed to be left for the valve, as in
`control.tolerant`: a ram that stalls is not driven harder."""


def velocity_gain(par: Parameters, load_pressure: float = 0.0) -> float:
    """Return the speed of a ram for a volt of command, m/(s V) (eqs. 2.1 and 2.2).

    With K = C_d w sqrt(2/rho) and the opening k_sp u, both ports of the symmetric valve take half
    of what the load pressure leaves of the supply: A v = K k_sp u sqrt((p_s - p_e - p_L) / 2)
    (Merritt 1967, ch. 6). `load_pressure` is p_L in Pa in the direction of the motion.
    """
    supply = par.supply_pressure - par.return_pressure
    left = max(supply - load_pressure, LEAST_ROOT * supply)
    opened = par.discharge_coefficient * par.area_gradient * par.valve_gain
    return opened * sqrt(left / par.density) / par.piston_area


def oil_stiffness(par: Parameters) -> float:
    """Return the stiffness in N/m of both oil columns, 4 beta A^2 / V_t (Merritt 1967, ch. 6).

    V_t is the oil volume of both chambers and their lines, with the ram at mid stroke.
    """
    stroke = par.stroke_max - par.stroke_min
    volume = par.piston_area * stroke + par.line_volume_1 + par.line_volume_2
    return 4.0 * par.bulk_modulus * par.piston_area**2 / volume


def hold_band(par: Parameters, sensors: SensorParameters) -> float:
    """Return the error in m within which a resting ram is left alone.

    As a ram breaks away, friction drops from stiction to its Coulomb level, and the oil's spring
    throws the ram by up to twice that force over its stiffness. From the edge of a band of half
    that jump the ram comes to rest within the band. A count of the encoder is added, within which
    the position is not known.
    """
    drop = max(par.stiction - par.coulomb, 0.0)
    return sensors.position_resolution + drop / oil_stiffness(par)


def valve_lag(par: Parameters) -> float:
    """Return by how much the ram's velocity lags a changing command, s.

    It is the lag of the valve's second-order dynamics, 2 d_m / omega_n, a delay of the command, and
    half a tick, as a command is held for one.
    """
    return 2.0 * par.valve_damping / par.valve_natural_frequency + par.command_delay + 0.5 * TICK


def feedforward_command(
    setpoint: Array, settings: ControlSettings, par: Parameters, limit: float
) -> Array:
    """Return the command in V (ticks,) by which a ram of the model follows the setpoint.

    The command is the setpoint's velocity over the speed for a volt at the load pressure that the
    model's friction and spring ask for, within +-`limit`. A jump of the setpoint gives the limit
    for a tick or two, which moves the ram by what the valve can deliver meanwhile.

    Args:
        setpoint: (ticks,) position, m.
        settings: the control settings.
        par: the parameters of the model, SI.
        limit: greatest command of either sign, V.
    """
    if setpoint.size < 2 or (settings.feedforward == "none" and not settings.feedforward_gain):
        return np.zeros(setpoint.size)
    lead = valve_lag(par) if settings.lead is None else settings.lead
    ticks = np.arange(setpoint.size)
    velocity = np.interp(ticks + lead / TICK, ticks, np.gradient(setpoint, TICK))
    if settings.feedforward_gain is not None:
        return np.clip(settings.feedforward_gain * velocity, -limit, limit)
    at = np.interp(ticks + lead / TICK, ticks, setpoint)
    sign = np.sign(velocity)
    spring = par.spring_stiffness * np.maximum(at - par.spring_contact, 0.0)
    friction = par.coulomb + par.viscous * np.abs(velocity) + sign * par.friction_asymmetry
    load = (friction + sign * (spring + par.constant_force)) / par.piston_area
    supply = par.supply_pressure - par.return_pressure
    least = LEAST_ROOT * supply
    left = np.maximum(supply - par.supply_droop * (par.piston_area * velocity) ** 2 - load, least)
    opened = par.discharge_coefficient * par.area_gradient * par.valve_gain
    per_volt = opened * np.sqrt(left / par.density) / par.piston_area
    return np.clip(velocity / per_volt, -limit, limit)


def frequencies_of(setpoint: Setpoint) -> tuple[float, ...]:
    """Return the frequencies in Hz that are corrected for a setpoint that repeats itself.

    They ascend; there are none for other setpoints, and at most `MOST_TONES`, the lowest ones. For
    a sine they are its own, its double and triple: friction and a deadband act twice a period, a
    constant force and unlike edges once. For a multisine they are its own.
    """
    if setpoint.quantity != "position":
        return ()
    if isinstance(setpoint, Sine):
        return tuple(k * setpoint.frequency_hz for k in _HARMONICS)
    if isinstance(setpoint, Multisine):
        return tuple(sorted(setpoint.frequencies_hz)[:MOST_TONES])
    return ()


def loop_answer(
    frequency_hz: float, par: Parameters, gain: float, settings: ControlSettings
) -> complex:
    """Return what the closed loop makes of a correction of the setpoint at a frequency.

    The sliding ram is an integrator of `velocity_gain` with the valve's lag as a delay; the
    correction enters by the gain, and the error by gain and integral.
    """
    s = 2j * pi * frequency_hz
    load = par.coulomb / par.piston_area
    plant = velocity_gain(par, load) * np.exp(-s * valve_lag(par)) / s
    integral = 0.0 if settings.integral_time is None else 1.0 / (s * settings.integral_time)
    return complex(plant * gain / (1.0 + plant * gain * (1.0 + integral)))
