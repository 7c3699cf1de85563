"""The integrator, which advances the plant over one command interval (1 ms).

The classical Runge-Kutta method of fourth order integrates all states except the bristles. These
relax at a rate of s_0 |v| / g(v), up to 2e4 1/s at full speed. They follow the exponential
Runge-Kutta scheme of the same order (Cox and Matthews 2002), which solves the relaxation exactly.
`step_length` shortens a step where friction changes quickly. Karnopp friction changes its mode,
stuck or sliding, between steps. docs/decisions/0010-integrator.md gives the reasons.
"""

from math import copysign, exp
from typing import Final

from rig.jit import njit
from rig.lanes import anywhere, everywhere, select

from .compiled import inlined
from .dynamics import environment_force, rates, slip_friction, slip_level
from .parameters import KARNOPP
from .step_length import SHORTEST, break_away_step, resolving_step, sliding_step, smooth_step

TICK: Final = 1e-3
"""Period of the loop in s, which is one command interval (table 2.1, T)."""

SUBSTEPS: Final = 2
"""Least number of integration steps in a tick, by default. `python -m tools.studies.convergence`
shows that this is converged."""

LONGEST_STEP: Final = TICK / SUBSTEPS
"""Longest integration step in s, by default."""

# Relaxations in a step from which on they are solved exactly; Runge-Kutta is stable up to 2.8.
_FAST_BRISTLE: Final = 2.0


@inlined
def _net_force(y, par):
    """Return the force in N, positive in extension, that stiction must balance in a ram at rest.

    It is the force of the pressures less that of spring, constant force and stops.

    `y` is the state in the order of `PlantState`.
    """
    pistons = par.piston_area * (max(y[2], 0.0) - max(y[3], 0.0))
    return pistons - environment_force(y[4], 0.0, par)


@inlined
def _mode_at_rest(net_force, par):
    """Return 0 if stiction holds a ram at rest, else the direction (+-1) of sliding (eq. 2.8)."""
    direction = copysign(1.0, net_force)
    return select(abs(net_force) > slip_friction(0.0, direction, par), direction, 0.0)


@inlined
def _with_friction(y, velocity, friction_state):
    """Return the state `y` with velocity and friction state replaced."""
    return (y[0], y[1], y[2], y[3], y[4], velocity, friction_state, y[7], y[8])


@inlined
def _with_spool_velocity(y, velocity):
    """Return the state `y` with the velocity of the spool replaced."""
    return (y[0], velocity, y[2], y[3], y[4], y[5], y[6], y[7], y[8])


@inlined
def _moved(y, h, k, friction_state):
    """Return the state y + h k, with the friction state replaced by the given one."""
    return (
        y[0] + h * k[0],
        y[1] + h * k[1],
        y[2] + h * k[2],
        y[3] + h * k[3],
        y[4] + h * k[4],
        y[5] + h * k[5],
        friction_state,
        y[7] + h * k[7],
        y[8] + h * k[8],
    )


@inlined
def _rates(y, command, par, fault):
    """Return the time derivatives of the state `y`, a tuple in the order of `PlantState`."""
    return rates(y[0], y[1], y[2], y[3], y[4], y[5], y[6], y[7], y[8], command, par, fault)


@inlined
def _bristle_weights(y, acceleration, h, command, par):
    """Return the bristles' relaxation rate (1/s), decay factor over half a step, and four weights.

    The weights in s are, in this order, that of half a step, and those of the first stage, of each
    middle stage and of the last stage. Where bristles relax too slowly for the exact solution, the
    rate is 0, the factor 1, and the weights are the classical h/2, h/6, h/3, h/6.

    Args:
        y: state at the start of the step.
        acceleration: acceleration of the ram there, m/s^2.
        h: length of the step, s.
        command: valve command, V.
        par: `Parameters`.
    """
    relaxation = 0.0
    velocity = y[5]
    if par.friction_law != KARNOPP:
        # The greater speed of both ends of the step, as bristles stiffen after a reversal.
        fastest = max(abs(velocity), abs(velocity + h * acceleration))
        stiff = par.bristle_stiffness * fastest
        fast = h * stiff > _FAST_BRISTLE * par.coulomb
        if anywhere(fast):
            level = slip_friction(abs(velocity), velocity, par)
            if anywhere(par.term_1_kind != 0.0):
                level = slip_level(velocity, y[4], y[0], y[2], y[3], command, par)
            relaxation = select(fast, stiff / level, 0.0)
    slow = relaxation * h < 1.0
    if everywhere(slow):
        return 0.0 * h, 1.0 + 0.0 * h, 0.5 * h, (1 / 6) * h, (1 / 3) * h, (1 / 6) * h
    r = select(slow, 1.0, relaxation * h)
    half = exp(-0.5 * r)
    full = half * half
    inverse = 1.0 / r
    scale = h * inverse * inverse * inverse
    first = (4.0 - r - full * (4.0 + 3.0 * r + r * r)) * scale
    middle = 2.0 * (r - 2.0 + full * (2.0 + r)) * scale
    last = (r * r - 3.0 * r + 4.0 - full * (4.0 + r)) * scale
    return (
        select(slow, 0.0, relaxation),
        select(slow, 1.0, half),
        select(slow, 0.5 * h, h * (1.0 - half) * inverse),
        select(slow, (1 / 6) * h, first),
        select(slow, (1 / 3) * h, middle),
        select(slow, (1 / 6) * h, last),
    )


@inlined
def _runge_kutta(y, k, h, command, par, fault):
    """Return the state after a step of h (s) from the state `y`, whose rates are `k`."""
    relaxation, half, reach, first, middle, last = _bristle_weights(y, k[5], h, command, par)
    z = y[6]
    drive_1 = k[6] + relaxation * z
    z_2 = half * z + reach * drive_1
    z_new = half * half * z + first * drive_1
    total = k
    point = _moved(y, 0.5 * h, k, z_2)
    # With a loop in place of three copies the compiler keeps more values in registers.
    for stage in range(2, 5):
        k = _rates(point, command, par, fault)
        drive = k[6] + relaxation * point[6]
        if stage == 4:
            z_new += last * drive
            total = _moved(total, 1.0, k, 0.0)
        else:
            z_new += middle * drive
            total = _moved(total, 2.0, k, 0.0)
            if stage == 2:
                point = _moved(y, 0.5 * h, k, half * z + reach * drive)
            else:
                point = _moved(y, h, k, half * z_2 + reach * (2.0 * drive - drive_1))
    return _moved(y, (1 / 6) * h, total, z_new)


@inlined
def _with_mode(y, par):
    """Return the state `y` with Karnopp's mode changed to sliding if a stuck ram breaks away.

    A stuck ram whose velocity is not zero also changes to sliding.
    """
    stuck = y[6] == 0.0
    if not anywhere(stuck):
        return y
    mode = select(y[5] == 0.0, _mode_at_rest(_net_force(y, par), par), copysign(1.0, y[5]))
    return _with_friction(y, y[5], select(stuck, mode, y[6]))


@inlined
def _stopped(y, par):
    """Return the state `y` with velocity 0 and a new Karnopp mode if the ram has reversed.

    A ram has reversed if it moves against its direction of sliding.
    """
    turned = y[6] * y[5] < 0.0
    if not anywhere(turned):
        return y
    mode = _mode_at_rest(_net_force(y, par), par)
    return _with_friction(y, select(turned, 0.0, y[5]), select(turned, mode, y[6]))


@inlined
def _karnopp_step(y, k, h, longest, par):
    """Return the step in s that ends where Karnopp's mode changes, else `h` (s).

    The step of a sliding ram is also shorter than `h` where friction falls steeply with speed.
    """
    return select(
        y[6] == 0.0,
        break_away_step(y, k, h, _net_force(y, par), par),
        sliding_step(y, k, h, longest, par),
    )


@inlined
def next_step(y, remaining, longest, shortest, command, par, fault):
    """Return the state after one more step, and the time in s that then remains of the interval.

    All arguments may be lanes with one common friction law. In a lane with no remaining time, the
    step has length 0.

    Args:
        y: state, a tuple in the order of `PlantState`.
        remaining: time that remains of the interval, s.
        longest: longest step, s.
        shortest: shortest step to which fast rates may shorten it, s.
        command: valve command, V.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
    """
    karnopp = par.friction_law == KARNOPP
    if karnopp:
        y = _with_mode(y, par)
    k = _rates(y, command, par, fault)
    h = smooth_step(y, k, longest, shortest, par)
    if karnopp:
        h = _karnopp_step(y, k, h, longest, par)
    # If less than two steps remain, take two equal ones and not a long and a very short one.
    even = select(h > 0.5 * remaining, 0.5 * remaining, h)
    h = select(h > 0.999999 * remaining, remaining, even)
    y = _runge_kutta(y, k, h, command, par, fault)
    limit = par.valve_rate_limit
    if anywhere(abs(y[1]) > limit):
        y = _with_spool_velocity(y, min(max(y[1], -limit), limit))
    if karnopp:
        y = _stopped(y, par)
    return y, remaining - h


@njit(cache=True, error_model="numpy", forceinline=True)
def advance(state, command, par, fault, duration=TICK, substeps=SUBSTEPS):
    """Advance `state` in place over one interval of constant command and faults.

    Args:
        state: float64 (9,), in the order of `PlantState`.
        command: valve command in V, held over the interval.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
        duration: length of the interval, s.
        substeps: least number of steps in the interval; more are taken where the motion needs them.
    """
    y = (
        state[0], state[1], state[2], state[3], state[4], state[5], state[6], state[7], state[8],
    )  # fmt: skip
    # A tuple is faster than an array, whose references numba counts in every call.
    fault = (
        fault[0], fault[1], fault[2], fault[3], fault[4], fault[5], fault[6], fault[7],
    )  # fmt: skip
    longest = resolving_step(y, duration / substeps, duration, par, fault)
    shortest = SHORTEST * duration / substeps
    remaining = duration
    while remaining > 0.0:
        y, remaining = next_step(y, remaining, longest, shortest, command, par, fault)
    state[0], state[1], state[2], state[3], state[4] = y[0], y[1], y[2], y[3], y[4]
    state[5], state[6], state[7], state[8] = y[5], y[6], y[7], y[8]
