"""Where a ram should be without an integral part, which the integral part goes by.

A loop needs an error to answer a step of its setpoint. That error is no sign of a null bias, a leak
or a load, and an integral part that sums it up drives the ram beyond its goal. So the integral part
sums up how far the ram is behind a reduced rig, which is computed before the motion begins and has
gain and feedforward only.
"""

from dataclasses import replace
from math import copysign, sqrt
from typing import Final

import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import TICK, Parameters

from .loop_model import LEAST_ROOT, feedforward_command, valve_lag
from .settings import ControlSettings

Array = NDArray[np.float64]

_IDEAL: Final = ControlSettings(feedforward="model")
"""The feedforward that is assumed: with it a ram of the model follows all that is no jump."""


@register_jitable
def reduced_velocity(command: float, position: float, before: float, par: Parameters) -> float:
    """Return the speed in m/s of a reduced rig, whose oil has no mass and no spring.

    It follows from the opening by eqs. 2.1 and 2.2, with friction and load taken from the supply
    pressure, as in `control.loop_model`. It is called from compiled code and from Python.

    Args:
        command: the command in V that the valve has come to.
        position: of the ram, m.
        before: speed of the tick before, m/s.
        par: the parameters of the rig, SI.
    """
    opening = par.valve_gain * command + par.spool_null_bias
    opening = copysign(max(abs(opening) - par.valve_deadband, 0.0), opening)
    sign = copysign(1.0, opening)
    friction = par.coulomb + par.viscous * abs(before) + sign * par.friction_asymmetry
    load = par.constant_force + par.spring_stiffness * max(position - par.spring_contact, 0.0)
    supply = par.supply_pressure - par.return_pressure
    least = LEAST_ROOT * supply
    supply -= par.supply_droop * (par.piston_area * before) ** 2
    left = max(supply - (friction + sign * load) / par.piston_area, least)
    coefficient = par.discharge_coefficient * par.area_gradient
    return coefficient * opening * sqrt(left / par.density) / par.piston_area


@njit(cache=True, error_model="numpy")
def _positions(setpoint, ahead, gain, low, high, lag, per_volt, par, found):
    """Fill `found` (ticks,) with the reduced ram's position; see `expected_position`.

    Commands are within `low` and `high`, V; `lag` is the part of a tick's change that the valve
    follows; with `per_volt` above 0 the ram goes by that many m/s for a volt, whatever its load.
    """
    position, sent, velocity = setpoint[0], 0.0, 0.0
    for k in range(setpoint.size):
        found[k] = position
        asked = min(max(gain * (setpoint[k] - position) + ahead[k], low), high)
        sent += lag * (asked - sent)
        if per_volt > 0.0:
            velocity = per_volt * sent
        else:
            velocity = reduced_velocity(sent, position, velocity, par)
        position += velocity * TICK


def expected_position(
    setpoint: Array,
    settings: ControlSettings,
    par: Parameters,
    gain: float,
    limit: float,
    compiled: bool = True,
) -> Array:
    """Return where the ram should be in each tick, m (ticks,); (0,) without an integral part.

    The ram begins at rest at the first setpoint. Null and deadband of the valve are taken to be
    those that the law makes up for, so that the ram always comes to a resting setpoint. The
    feedforward is taken to be exact, whether the law has one or not: a motion without jumps for
    which the valve has the flow is expected to be followed. So what a law without feedforward lags
    in such a motion is still integrated.

    Args:
        setpoint: (ticks,) position, m.
        settings: the control settings.
        par: the parameters of the model, SI.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        compiled: whether it is computed by compiled code; plain Python gives the same numbers, and
            takes 2 s for a million ticks.
    """
    if settings.integral_time is None or not setpoint.size:
        return np.empty(0)
    ideal = replace(_IDEAL, feedforward_gain=settings.feedforward_gain or None)
    ahead = feedforward_command(setpoint, ideal, par, limit)
    par = par._replace(spool_null_bias=0.0, valve_deadband=0.0)
    found = np.empty(setpoint.size)
    fill = _positions if compiled else getattr(_positions, "py_func", _positions)
    fill(
        np.ascontiguousarray(setpoint, np.float64), ahead, float(gain),
        settings.deadband - settings.null - limit, limit - settings.null - settings.deadband,
        min(TICK / valve_lag(par), 1.0), 1.0 / (settings.feedforward_gain or np.inf), par, found,
    )  # fmt: skip
    return found
