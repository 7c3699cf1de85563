"""Integrates the plant over one command interval (1 ms) in fixed substeps.

Classical Runge-Kutta of fourth order carries all states but the friction's. The bristle relaxes at
s_0 |v| / g(v), up to 2e4 1/s at full speed, and is advanced exactly for the substep's mean velocity, so
that sliding fast costs no stability. Karnopp friction changes mode (stuck, sliding) between substeps.
"""

from math import exp
from typing import Final

from numba import njit

from .dynamics import environment_force, rates, slip_friction
from .parameters import KARNOPP

TICK: Final = 1e-3
"""The loop's period in s: one command interval (table 2.1, T)."""

SUBSTEPS: Final = 4
"""Substeps a tick. Halving the step moves a run by less than a tenth of a sensor's resolution."""


# Above this many relaxations a substep the bristle is in equilibrium with the sliding velocity, and
# Runge-Kutta, stable to 2.8, would only just follow it.
_FAST_BRISTLE: Final = 2.0


@njit(cache=True, error_model="numpy")
def _net_force(p1, p2, position, velocity, par):
    """Return the force in N that friction has to hold: pistons less spring and stroke ends."""
    pistons = par.piston_area * (max(p1, 0.0) - max(p2, 0.0))
    return pistons - environment_force(position, velocity, par)


@njit(cache=True, error_model="numpy")
def _karnopp_mode(direction, velocity, previous_velocity, net_force, par):
    """Return (velocity, direction) after a substep: stick, keep sliding, or break away (eq. 2.16).

    The ram sticks when its velocity has changed sign, or is within v_o of zero and falling, while the
    net force is below stiction; it breaks away towards the force when that exceeds stiction.
    """
    hold_extending = par.stiction + par.friction_asymmetry
    hold_retracting = par.stiction - par.friction_asymmetry
    held = -hold_retracting <= net_force <= hold_extending
    if direction == 0.0:
        if held:
            return 0.0, 0.0
        return 0.0, 1.0 if net_force > 0.0 else -1.0
    reversed_ = velocity * direction <= 0.0
    stopping = abs(velocity) <= par.stick_velocity and abs(velocity) < abs(previous_velocity)
    if held and (reversed_ or stopping):
        return 0.0, 0.0
    if reversed_:
        return 0.0, 1.0 if net_force > 0.0 else -1.0
    return velocity, direction


@njit(cache=True, error_model="numpy")
def advance(state, command, par, fault, duration=TICK, substeps=SUBSTEPS):
    """Advance `state` in place over one interval of constant command and faults.

    Args:
        state: float64 (9,), in the order of `PlantState`.
        command: valve command in V, held over the interval.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
        duration: interval in s.
        substeps: number of Runge-Kutta steps in the interval.
    """
    h = duration / substeps
    s, w, p1, p2, x, v, z, ps, pe = (
        state[0], state[1], state[2], state[3], state[4], state[5], state[6], state[7], state[8],
    )  # fmt: skip
    karnopp = par.friction_law == KARNOPP
    for _ in range(substeps):
        if karnopp and z == 0.0:
            v, z = _karnopp_mode(0.0, v, v, _net_force(p1, p2, x, v, par), par)
        fast = not karnopp and h * par.bristle_stiffness * abs(v) > _FAST_BRISTLE * par.coulomb
        relaxation = decay = 0.0
        if fast:
            relaxation = par.bristle_stiffness * abs(v) / slip_friction(v, par)
            decay = exp(-0.5 * h * relaxation)
        # Each stage starts from the step's start, plus its own fraction of the previous rates.
        s1, w1, p11, p21, x1, v1, z1, ps1, pe1 = s, w, p1, p2, x, v, z, ps, pe
        ds = dw = dp1 = dp2 = dx = dv = dz = dps = dpe = 0.0
        for stage in range(4):
            a = rates(s1, w1, p11, p21, x1, v1, z1, ps1, pe1, command, par, fault)
            weight = h / 6.0 if stage in (0, 3) else h / 3.0
            ds += weight * a[0]
            dw += weight * a[1]
            dp1 += weight * a[2]
            dp2 += weight * a[3]
            dx += weight * a[4]
            dv += weight * a[5]
            dz += weight * a[6]
            dps += weight * a[7]
            dpe += weight * a[8]
            if stage == 3:
                break
            c = h if stage == 2 else 0.5 * h
            if fast:
                kept = decay * decay if stage == 2 else decay
                z1 = kept * z + (1.0 - kept) * v1 / relaxation
            else:
                z1 = z + c * a[6]
            s1 = s + c * a[0]
            w1 = w + c * a[1]
            p11 = p1 + c * a[2]
            p21 = p2 + c * a[3]
            x1 = x + c * a[4]
            v1 = v + c * a[5]
            ps1 = ps + c * a[7]
            pe1 = pe + c * a[8]
        if fast:
            z = decay * decay * z + (1.0 - decay * decay) * (dx / h) / relaxation
        else:
            z += dz
        previous = v
        s += ds
        w += dw
        p1 += dp1
        p2 += dp2
        x += dx
        v += dv
        ps += dps
        pe += dpe
        if karnopp and z != 0.0:
            v, z = _karnopp_mode(z, v, previous, _net_force(p1, p2, x, v, par), par)
    state[0], state[1], state[2], state[3], state[4] = s, w, p1, p2, x
    state[5], state[6], state[7], state[8] = v, z, ps, pe
