"""Tolerant control: compensation of a confirmed leak in the position loop's command.

The proportional command would give a healthy rig a certain velocity. A leak lowers that velocity,
and as it drains the chambers, the same opening of the valve passes another flow. From the leak
coefficients and both pressures, this module computes the opening that gives the same velocity in
spite of the leak (docs/tolerant_control.md).
"""

from math import isnan, sqrt
from typing import Final

from rig.jit import njit
from rig.plant import LITRE_PER_MINUTE, inlined, valve_conductance

TOLERANT_STATE: Final = 6
"""Length of the state array of `tolerant_command`, float64, zeros at the start.

It holds the share of the compensation in use (0 to 1), the leak coefficients in use (chamber 1,
chamber 2, internal; m^3/(s Pa^0.5)), and both pressures after a low-pass (Pa)."""

BLEND_S: Final = 0.5
"""Seconds over which the compensation is faded in and out, and follows a new leak estimate."""

PRESSURE_FILTER_S: Final = 0.02
"""Time constant in s of the low-pass of the pressures. It is half way, on a logarithmic scale,
between the position loop's crossover (3.5 rad/s) and the oil column's resonance (509 rad/s), so
that it affects neither."""

FALSE_ALARM_FLOW: Final = 0.1 * LITRE_PER_MINUTE
"""The part of each leak's flow, in m^3/s, that is left without compensation. A false alarm may be
this large, and the loop copes with a leak of this size. Of a larger leak, the excess is
compensated."""

_ROUNDING: Final = 2e4
"""Pressure drop in Pa below which the root is rounded off. Transducers with noise of 3e4 Pa read
such drops where there are none."""
_LEAST_DROP: Final = 0.05
"""Least pressure drop over the valve that is assumed, as a part of the supply pressure.

The supply pressure itself may be off by as much. A ram that stalls is not driven harder."""


@inlined
def _root(drop):
    """Return sgn(drop) (sqrt(|drop| + c) - sqrt(c)) of a pressure drop in Pa, c = `_ROUNDING`.

    This is the signed square root, rounded off about zero. It is nowhere larger or steeper than the
    root itself, so that the compensation never grows by more than the leak, whatever the pressures
    do, and noise about zero hardly causes any.
    """
    root = sqrt(abs(drop) + _ROUNDING) - sqrt(_ROUNDING)
    return root if drop >= 0.0 else -root


@inlined
def _beyond_false_alarms(coefficient, drop):
    """Return the part of a leak coefficient that is compensated, in m^3/(s Pa^0.5); at least 0.

    It is the excess over the coefficient of a leak with `FALSE_ALARM_FLOW` at the pressure drop
    `drop` (Pa).
    """
    return max(coefficient - FALSE_ALARM_FLOW / sqrt(drop), 0.0)


@inlined
def _compensated(command, k_1, k_2, k_12, p1, p2, par):
    """Return the command in V that moves a leaking ram as fast as `command` moves a healthy one.

    k_1, k_2 and k_12 are the leaks' coefficients in m^3/(s Pa^0.5): of chamber 1, of chamber 2 and
    between them. p1 and p2 are the chambers' pressures in Pa.

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
    # The valve opens in the direction of the flow, which may differ from that of the command.
    if flow >= 0.0:
        passed = 0.5 * (sqrt(supply - p1) + sqrt(p2))
    else:
        passed = 0.5 * (sqrt(supply - p2) + sqrt(p1))
    return flow / (opened * max(passed, sqrt(0.5 * least)))


@njit(cache=True, error_model="numpy", nogil=True)
def tolerant_command(command, leaks, p1, p2, par, limit, period, state):
    """Return the valve command in V that compensates confirmed leaks; it is called once a tick.

    Of each leak only the excess over `FALSE_ALARM_FLOW` is compensated; a smaller one counts as not
    confirmed. The compensation is faded in and out over `BLEND_S`, and the result is limited to
    +-`limit`. If no leak is confirmed and none was being compensated, the result is `command`
    itself, bit for bit. If the command, a pressure or a coefficient is NaN, the result is
    `command`, and the compensation starts again from zero.

    Args:
        command: command of the proportional loop, V, within +-limit.
        leaks: coefficients (k_el1, k_el2, k_il) of the leaks that are confirmed now,
            m^3/(s Pa^0.5), 0 for none; a tuple or an array, as
            `estimator.leaks.detection.Decision.present_leaks`.
        p1: the filter's latest estimate of chamber 1's pressure, Pa.
        p2: the filter's latest estimate of chamber 2's pressure, Pa.
        par: the `Parameters` that the filter assumes.
        limit: greatest command of either sign, V.
        period: period of the loop, s.
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
