"""The length of the next integration step, which is shorter where the plant is fast or reverses.

Most rules compare a rate of the plant with the rate that the longest step resolves, and shorten the
step in proportion; if the longest step is halved, so are these steps. Other rules end a step at an
event: the ram comes to rest or breaks away, or an edge of the valve opens or closes.
"""

from math import copysign, sqrt
from typing import Final

from rig.lanes import anywhere, everywhere, select

from .compiled import inlined
from .dynamics import (
    ATMOSPHERE,
    LEVEL_FLOOR,
    aeration_softening,
    chamber_volumes,
    is_real_valve,
    lapped,
    slip_friction,
    stops,
    total_mass,
    valve_conductance,
)
from .parameters import KARNOPP

# The following rates are resolved by half a millisecond, the longest step of a default run.
_COLUMN_RATE: Final = 800.0
"""Natural frequency in rad/s of the ram on the oil of the smaller chamber."""

_EDGE_RATE: Final = 3e5
"""Rate K in Pa^0.5/s at which a valve edge fills its chamber, dp/dt = -K sqrt(p).

Runge-Kutta becomes unstable where the relative rate times the step h exceeds 2.8. This is so at
drops below (K h / 5.6)^2, where the pressure then chatters: with K h = 150, by some kPa."""

_LINE_RATE: Final = 1000.0
"""Rate in 1/s at which the supply and return lines fill; a restriction makes it faster."""

_VALVE_RATE: Final = 1500.0
"""Rate in 1/s of the motion of the spool."""

_BRISTLE_RATE: Final = 2000.0
"""Rate in 1/s at which the ram relaxes on its bristles before it slips."""

_CONTACT_RATE: Final = 600.0
"""Natural frequency in rad/s of the ram on a stroke end."""

_SPEED_RATE: Final = 2000.0
"""Rate in 1/s: acceleration divided by the velocity scale on which friction changes."""

_BELL_SCALE: Final = 0.3
"""Velocity scale on which friction changes near standstill, as a part of the width v_s1 of the
bristles' damping."""

_LOADING_RATE: Final = 200.0
"""Rate in 1/s: change of the bristles' force, divided by the Coulomb level."""

_AERATION_RATE: Final = 300.0
"""Relative rate in 1/s of a chamber's absolute pressure where entrained air softens the oil."""

_RUNAWAY_RATE: Final = 1000.0
"""Rate in 1/s at which a small velocity grows down the Stribeck slope."""

SHORTEST: Final = 1.0 / 32.0
"""Least step to which a rate may shorten a step, as a part of the longest step."""

_EVENT: Final = 1e-6
"""Shortest step in s that ends at a standstill, a break-away or an opening edge."""


@inlined
def resolving_step(y, longest, duration, par, fault):
    """Return the longest step in s to take in an interval, by oil, lines, spool and bristles.

    The step is `longest` if it resolves these four, and shorter if one of them is too fast for it.

    Args:
        y: state at the start of the interval, in the order of `PlantState`.
        longest: greatest result, s; the least result is `SHORTEST` times this.
        duration: length of the interval, s.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
    """
    volume = min(*chamber_volumes(y[4], par))
    mass = total_mass(par)
    # Rates are compared first. Divisions and roots are slow and mostly would not shorten the step.
    h = longest + 0.0 * volume
    column = par.piston_area * par.piston_area * par.bulk_modulus / mass
    stiff = column > _COLUMN_RATE * _COLUMN_RATE * volume
    if anywhere(stiff):
        h = select(stiff, longest * min(1.0, _COLUMN_RATE * sqrt(volume / column)), h)
    opening = lapped(y[0] + par.spool_null_bias, par)
    underlap = par.valve_underlap_leakage
    edge = valve_conductance(par) * (abs(opening) + underlap)
    edge *= max(1.0, 1.0 - par.valve_flow_asymmetry)
    fast = edge * par.bulk_modulus > _EDGE_RATE * volume
    if anywhere(fast):
        filling = edge * par.bulk_modulus / volume
        extending = opening >= 0.0
        drop_1 = select(extending, y[7] - y[2], y[2] - y[8])
        drop_2 = select(extending, y[3] - y[8], y[7] - y[3])
        least = min(abs(drop_1), abs(drop_2))
        if anywhere(underlap != 0.0):
            # The opposite edges may be open too.
            other_1 = select(extending, y[2] - y[8], y[7] - y[2])
            other_2 = select(extending, y[7] - y[3], y[3] - y[8])
            closing = abs(opening) < underlap
            least = select(closing, min(least, min(abs(other_1), abs(other_2))), least)
        # With a larger drop than this, the chamber is not yet full at the end of the interval.
        full = 4.0 * least < filling * filling * duration * duration
        h = select(fast & full, min(h, longest * _EDGE_RATE / filling), h)
    restriction = max(par.supply_droop, par.return_back_pressure + fault[7])
    filled = 1.0 + restriction * edge * edge
    valve_rate = par.valve_natural_frequency * max(1.0, 2.0 * par.valve_damping)
    quick = (filled > _LINE_RATE * par.line_time_constant) | (valve_rate > _VALVE_RATE)
    if anywhere(quick):
        line_rate = filled / par.line_time_constant
        fastest = max(line_rate / _LINE_RATE, valve_rate / _VALVE_RATE)
        h = select(quick, min(h, longest / max(fastest, 1.0)), h)
    if par.friction_law != KARNOPP:
        bristles = _BRISTLE_RATE * mass
        quick = (par.bristle_damping > bristles) | (
            par.bristle_stiffness > _BRISTLE_RATE * bristles
        )
        if anywhere(quick):
            fastest = max(par.bristle_damping / mass, sqrt(par.bristle_stiffness / mass))
            h = select(quick, min(h, longest * _BRISTLE_RATE / fastest), h)
    return max(h, SHORTEST * longest)


@inlined
def _kink_step(opening, speed, kink, h):
    """Return the step in s that ends where a moving opening reaches a kink, else `h` (s).

    The result is also `h` if the kink is 1e-6 s ahead or less, or `h` or more. Opening and kink are
    in m, the speed of the opening is in m/s.
    """
    ahead = (kink - opening) / select(speed == 0.0, 1e-30, speed)
    return select((ahead > _EVENT) & (ahead < h), ahead, h)


@inlined
def _edge_step(y, k, h, par):
    """Return the step in s that ends where a valve edge with a lap opens or closes, else `h` (s).

    An edge that does so within 1e-6 s does not count. `y` is the state and `k` its rates.
    """
    spool, speed = y[0] + par.spool_null_bias, k[0]
    lap = par.valve_deadband
    outer = lap + par.valve_underlap_leakage
    h = _kink_step(spool, speed, outer, h)
    h = _kink_step(spool, speed, -outer, h)
    h = _kink_step(spool, speed, lap, h)
    return _kink_step(spool, speed, -lap, h)


@inlined
def standstill_step(y, k, h):
    """Return the step in s that ends where a ram that slows down comes to rest, else `h` (s).

    The result is `h` if the ram does not come to rest within `h`. If it does so within 1e-6 s, the
    result is 1e-6 s. `y` is the state and `k` its rates.
    """
    velocity, acceleration = y[5], k[5]
    stops = (velocity * acceleration < 0.0) & (abs(velocity) < abs(acceleration) * h)
    if anywhere(stops):
        h = select(stops, max(abs(velocity / acceleration), _EVENT), h)
    return h


@inlined
def _aeration_rate(pressure, slope, h, par):
    """Return the rate in 1/s by which oil with air limits a step of `h` (s); 0 without air.

    It is the magnitude of the pressure's slope (Pa/s) divided by the lowest absolute pressure in
    the step, times the part of the bulk modulus that the air takes away there. `pressure` (Pa,
    gauge) is that at the start of the step; a gauge pressure below zero counts as zero.
    """
    lowest = min(pressure, pressure + h * slope)
    softened = 1.0 - aeration_softening(lowest, par)
    return softened * abs(slope) / (max(lowest, 0.0) + ATMOSPHERE)


@inlined
def smooth_step(y, k, longest, shortest, par):
    """Return the step in s, at most `longest`, that resolves friction, stops and oil with air.

    The step also ends where a valve edge with a lap opens or closes and, if friction or a stop has
    shortened the step, where a ram that slows down comes to rest. By these two events it may become
    shorter than `shortest`, but not shorter than 1e-6 s.

    Args:
        y: state at the start of the step, in the order of `PlantState`.
        k: rates of the state.
        longest: longest step, s.
        shortest: least step to which a rate of friction, stops or oil may shorten it, s.
        par: `Parameters`.
    """
    if anywhere(par.entrained_air != 0.0):
        rate_1 = _aeration_rate(y[2], k[2], longest, par)
        rate = max(rate_1, _aeration_rate(y[3], k[3], longest, par))
        longest = max(longest * _AERATION_RATE / max(rate, _AERATION_RATE), shortest)
    if anywhere(is_real_valve(par)):
        longest = _edge_step(y, k, longest, par)
    velocity, acceleration = y[5], abs(k[5])
    speed = abs(velocity)
    width = par.bristle_damping_velocity
    speed_rate = _SPEED_RATE * max(_BELL_SCALE * width, speed - width)
    loading = par.bristle_stiffness * abs(k[6])
    loading_rate = _LOADING_RATE * max(par.coulomb, LEVEL_FLOOR)
    ahead = y[4] + longest * velocity
    low, high = stops(par)
    hits = (speed > 0.1 * width) & ((ahead < low) | (ahead > high))
    smooth = (acceleration <= speed_rate) & (loading <= loading_rate) & ~hits
    if everywhere(smooth):
        return longest
    loaded = loading * (1.0 / loading_rate) * speed_rate
    h = longest * speed_rate / max(max(acceleration, loaded), speed_rate)
    if anywhere(hits):
        contact = longest * _CONTACT_RATE * sqrt(total_mass(par) / par.stop_stiffness)
        h = select(hits, min(h, contact), h)
    return select(smooth, longest, standstill_step(y, k, max(h, shortest)))


@inlined
def break_away_step(y, k, h, net_force, par):
    """Return the step in s that ends where a stuck ram breaks away, else `h` (s).

    The result is `h` if the ram does not break away within `h`. If it does so within 1e-6 s, the
    result is 1e-6 s. `y` is the state, `k` its rates, and `net_force` (N) the force that stiction
    balances.
    """
    loading = par.piston_area * (k[2] - k[3])
    gap = copysign(slip_friction(0.0, loading, par), loading) - net_force
    return select(abs(gap) < abs(loading) * h, max(gap / loading, _EVENT), h)


@inlined
def sliding_step(y, k, h, longest, par):
    """Return the step in s, at most `h` (s), for a ram that slides with Karnopp friction.

    It is shorter than `h` at low speeds if friction falls steeply with speed (Stribeck), and it
    ends where a ram that slows down comes to rest. `y` is the state, `k` its rates, and `longest`
    the longest step in s, from which the step for steep friction follows.
    """
    slope = (par.stiction - par.coulomb) / par.stribeck_velocity
    runaway = _RUNAWAY_RATE * total_mass(par)
    runs_away = (abs(y[5]) < 2.0 * par.stribeck_velocity) & (slope > runaway)
    h = select(runs_away, min(h, longest * runaway / slope), h)
    return standstill_step(y, k, h)
