"""Keeps the position loop's motion under a confirmed leak (docs/tolerant_control.md).

The proportional command asks a healthy rig for a velocity. A leak lowers that velocity, and drained
chambers change the flow through an opening. This module finds the opening that yields the velocity
asked for, from the leak coefficients and both pressures.
"""

from math import isnan, sqrt
from typing import Final

from rig.jit import njit
from rig.plant import LITRE_PER_MINUTE, inlined, valve_conductance

TOLERANT_STATE: Final = 6
"""float64 (6,), zeros at the start: how much of the compensation is in use (0 to 1), the leak
coefficients in use (1, 2, internal; m^3/(s Pa^0.5)), both pressures low-passed (Pa)."""

BLEND_S: Final = 0.5
"""Time over which the compensation comes and goes, and follows a new estimate."""

PRESSURE_FILTER_S: Final = 0.02
"""Time constant of the pressures' low-pass: half way, on a logarithmic scale, between the position
loop's crossover (3.5 rad/s) and the oil column's resonance (509 rad/s), so that neither sees it."""

FALSE_ALARM_FLOW: Final = 0.1 * LITRE_PER_MINUTE
"""m^3/s. A false alarm may be this large, and a leak this small does not trouble the loop: no leak
up to this flow is made up for, and of a larger one this much is left."""

_ROUNDING: Final = 2e4
"""Pa. Drops of this size and less are what transducers read (noise 3e4 Pa) where there is none."""
_LEAST_DROP: Final = 0.05
"""Least pressure drop over the valve that is assumed, as a part of the supply pressure.

The supply pressure itself may be off by as much. A ram that stalls is left to stall."""


@inlined
def _root(drop):
    """Return `rig.plant.signed_root` rounded off at zero: never larger than the root, nor steeper.

    So what is made up for never grows by more than what leaks, whatever the pressures do; and noise
    around an empty chamber is hardly taken for oil.
    """
    root = sqrt(abs(drop) + _ROUNDING) - sqrt(_ROUNDING)
    return root if drop >= 0.0 else -root


@inlined
def _beyond_false_alarms(coefficient, drop):
    """Return what to make up for of a leak coefficient, whose flow is quoted at `drop` (Pa)."""
    return max(coefficient - FALSE_ALARM_FLOW / sqrt(drop), 0.0)


@inlined
def _compensated(command, k_1, k_2, k_12, p1, p2, par):
    """Return the command in V that moves a leaking ram as `command` moves a healthy one.

    With K = C_d w sqrt(2/rho), pressures above the return, p_s the supply and p_L = p1 - p2, a
    healthy rig moves at A v = K x sqrt((p_s - sgn(x) p_L) / 2) (Merritt 1967, ch. 6). Half the sum
    of both chambers' balances (eq. 2.3) at constant p_L is A v = K x' g - (q_1 - q_2) / 2 - q_12,
    where g is the mean of the roots of both drops over the valve. Equal v gives x'.
    """
    supply = par.supply_pressure - par.return_pressure
    least = _LEAST_DROP * supply
    p1 = min(max(p1 - par.return_pressure, 0.0), supply)
    p2 = min(max(p2 - par.return_pressure, 0.0), supply)
    load = p1 - p2
    opened = valve_conductance(par) * par.valve_gain
    healthy = supply - load if command >= 0.0 else supply + load
    leaking = 0.5 * (k_1 * _root(p1) - k_2 * _root(p2)) + k_12 * _root(load)
    flow = opened * command * sqrt(0.5 * max(healthy, least)) + leaking
    # The sign of the flow, not of the command, says which way the valve is to open.
    if flow >= 0.0:
        passed = 0.5 * (sqrt(supply - p1) + sqrt(p2))
    else:
        passed = 0.5 * (sqrt(supply - p2) + sqrt(p1))
    return flow / (opened * max(passed, sqrt(0.5 * least)))


@njit(cache=True, error_model="numpy", nogil=True)
def tolerant_command(command, leaks, p1, p2, par, limit, period, state):
    """Return the valve command in V that makes up for confirmed leaks; called once a tick.

    With no leak confirmed, and none made up for within the last `BLEND_S`, it is `command` itself,
    bit for bit. The compensation comes and goes over `BLEND_S`. Without a command, a pressure or
    one of the coefficients (NaN) it is `command`, and the compensation begins afresh.

    Args:
        command: of the proportional loop, V, within +-limit.
        leaks: coefficients (k_el1, k_el2, k_il) of the leaks confirmed now, m^3/(s Pa^0.5), 0 where
            there is none; a tuple or an array. `estimator.leaks.detection.Decision.present_leaks`.
        p1: the filter's latest estimate of chamber 1's pressure, Pa.
        p2: the filter's latest estimate of chamber 2's pressure, Pa.
        par: the `Parameters` that the filter assumes.
        limit: greatest command of either sign, V.
        period: s, of the loop.
        state: float64 (TOLERANT_STATE,), zeros at the start; updated.
    """
    half_supply = 0.5 * (par.supply_pressure - par.return_pressure)
    k_1 = _beyond_false_alarms(leaks[0], half_supply)
    k_2 = _beyond_false_alarms(leaks[1], half_supply)
    # An internal leak's flow is quoted at what a slow ram needs against its friction.
    k_12 = _beyond_false_alarms(leaks[2], 1.5 * par.coulomb / par.piston_area)
    confirmed = k_1 > 0.0 or k_2 > 0.0 or k_12 > 0.0
    if not confirmed and state[0] == 0.0:
        return command
    if isnan(command + leaks[0] + leaks[1] + leaks[2] + p1 + p2):
        state[0] = 0.0
        return command
    step = min(period / BLEND_S, 1.0)
    if state[0] == 0.0:
        state[1], state[2], state[3], state[4], state[5] = k_1, k_2, k_12, p1, p2
    if confirmed:
        state[0] = min(state[0] + step, 1.0)
        state[1] += step * (k_1 - state[1])
        state[2] += step * (k_2 - state[2])
        state[3] += step * (k_12 - state[3])
    else:
        state[0] = max(state[0] - step, 0.0)
    fresh = min(period / PRESSURE_FILTER_S, 1.0)
    state[4] += fresh * (p1 - state[4])
    state[5] += fresh * (p2 - state[5])
    wanted = _compensated(command, state[1], state[2], state[3], state[4], state[5], par)
    return min(max(command + state[0] * (wanted - command), -limit), limit)
