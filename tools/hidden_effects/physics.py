"""The equations of the independent rig, their integration and its sensors, compiled.

The integrator is simpler than the product's on purpose: Kutta's third order, in steps of 20 us. All
compiled functions are in this file, as numba recompiles a function only if its own file changed.
"""

from math import atanh, exp, floor, log10, pi, sin, sqrt, tanh
from typing import Any, Final

import numpy as np
from numba import njit  # noqa: TID251 (this simulator imports nothing of the product)

TICK: Final = 1e-3
"""s: time between two samples."""
STEPS: Final = 50
"""Integration steps in a tick; each is 20 us long."""
STATES: Final = (
    "spool", "spool_speed", "pilot", "pilot_speed", "position", "speed", "seal_bend",
    "pressure_1", "pressure_2", "supply", "tank", "hung", "hung_speed", "pocket",
)  # fmt: skip
(
    SPOOL, SPOOL_SPEED, PILOT, PILOT_SPEED, POSITION, SPEED, BEND, P1, P2, SUPPLY, TANK,
    HUNG, HUNG_SPEED, POCKET,
) = range(14)  # fmt: skip
COUNT: Final = 3e-5
"""m: length of one encoder count."""
READINGS: Final = ("command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")

_ATMOSPHERE: Final = 1.01325e5
_LONGEST_DELAY: Final = 64
_STATES: Final = len(STATES)
# Where other formulas agree with those of the catalogue: pressure of a chamber at rest and across
# the piston, opening, speed, flow, and depth in a stroke end.
_HALF_PUMP: Final = 6.9e6
_DROP: Final = 2e6
_WIDE_OPEN: Final = 1e-4
_BRISK: Final = 0.1
_AMPLE_FLOW: Final = 3e-4
_DEEP: Final = 1e-4
_SILTING: Final = 0.05  # s for which a spool must rest to be silted up
_PART: Final[dict[str, Any]] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""Options of functions that only compiled code calls: to read a rig from Python is much code."""


@njit(cache=True, error_model="numpy", **_PART)
def _root(pressure):
    """Return the square root of the magnitude of `pressure`, with the sign of `pressure`."""
    return sqrt(pressure) if pressure >= 0.0 else -sqrt(-pressure)


@njit(cache=True, error_model="numpy", **_PART)
def _bump(place, middle, width):
    """Return exp(-((place - middle) / width)^2): 1 at `middle`, and nearly 0 far from it."""
    distance = (place - middle) / width
    return exp(-distance * distance)


@njit(cache=True, error_model="numpy")
def _power(value, exponent):
    """Return a power of the magnitude of `value`, with the sign of `value`."""
    return abs(value) ** exponent if value >= 0.0 else -(abs(value) ** exponent)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _compliance(r, pressure, clock):
    """Return the compliance of liquid and air bubbles together, 1/Pa (Merritt 1967, ch. 1)."""
    liquid = 1.0 / (r.oil_stiffness * (1.0 - r.oil_trend * clock))
    if r.stiffening != 0.0:
        # Lee 1977: the logarithm of 90 p/28 MPa + 3.
        liquid *= log10(90.0 * _HALF_PUMP / 28e6 + 3.0) / log10(90.0 * pressure / 28e6 + 3.0)
    absolute = pressure + _ATMOSPHERE
    if r.air_exponent != 1.0:
        share = (_ATMOSPHERE / absolute) ** (1.0 / r.air_exponent)
        return liquid + r.air * share / (r.air_exponent * absolute)
    if r.air_gone != 0.0:
        free = max(0.0, 1.0 - pressure / r.air_gone)
        dissolving = _ATMOSPHERE / (absolute * r.air_gone) if free > 0.0 else 0.0
        return liquid + r.air * (free * _ATMOSPHERE / (absolute * absolute) + dissolving)
    return liquid + r.air * _ATMOSPHERE / (absolute * absolute)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _relief(r, pressure, chamber):
    """Return the flow (m^3/s) out of a chamber through a relief valve that does not close."""
    if r.relief_only != 0.0 and r.relief_only != chamber:
        return 0.0
    return r.relief_leak * max(0.0, pressure - r.relief_pressure)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _leak(r, coefficient, linear, drop):
    """Return the flow (m^3/s) of a leak under a pressure drop (Pa), by the formula that `r` has."""
    if r.leak_transition != 0.0:
        return coefficient * drop / sqrt(abs(drop) + r.leak_transition)
    return coefficient * _root(drop) + linear * drop


@njit(cache=True, error_model="numpy", forceinline=True)
def slip_force(r, position, speed, pressure_1, pressure_2):
    """Return the friction (N) at which the seals slip: Stribeck's curve with the hidden effects.

    It is 10 N at least, and never negative; the sign of the speed chooses the part that depends on
    the direction. `r` holds the `RigValues`; position is in m, speed in m/s, pressures in Pa.
    """
    ratio = abs(speed) / r.stribeck
    if r.hess_soom != 0.0:
        share = 1.0 / (1.0 + ratio * ratio)
    elif r.stribeck_exponent == 1.0:
        share = exp(-ratio)
    else:
        share = exp(-(ratio**r.stribeck_exponent))
    level = r.sliding + (r.break_away - r.sliding) * share
    if speed > 0.0:
        level += r.direction_friction
    elif speed < 0.0:
        level -= r.direction_friction
    if r.tight_spot != 0.0:
        level += r.tight_spot * _bump(position, r.tight_place, r.tight_width)
    level += r.squeeze * pressure_1 * pressure_1
    level += r.squeeze_2 * pressure_2 * pressure_2
    level += r.level_by_pressure * (abs(pressure_1 - pressure_2) - _DROP)
    return max(10.0, level + r.side_load * position)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _stop_force(r, depth, approach):
    """Return the force (N) of a stroke end at a depth (m) beyond it and a speed of approach."""
    force = r.stop_stiffness * depth
    if r.stop_exponent != 1.0:
        force *= (depth / _DEEP) ** (r.stop_exponent - 1.0)
    if r.stop_damping != 0.0:
        return max(0.0, force + r.stop_damping * approach)
    return force * max(0.0, 1.0 + r.stop_loss * approach)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _outside_force(r, clock, position, speed):
    """Return the external force (N) against extension: spring, ends, weight, cogging, cushion."""
    travel = max(0.0, position - r.spring_contact)
    if r.spring_hardening != 0.0:
        travel *= 1.0 + (travel / r.spring_hardening) ** 2
    force = r.push_back + r.spring * travel
    beyond = position - r.stroke_high
    if beyond > 0.0:
        force += _stop_force(r, beyond, speed)
    short = r.stroke_low - position
    if short > 0.0:
        force -= _stop_force(r, short, -speed)
    if r.cogging != 0.0:
        force += r.cogging * sin(2.0 * pi * position / r.cogging_pitch + r.cogging_phase)
    if r.cushion != 0.0:
        force += r.cushion * max(0.0, position - r.cushion_place) * speed * abs(speed)
    return force + r.loose_force if clock >= r.loose_at else force


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _lapped(r, opening):
    """Return the opening (m) that the overlap of the edges leaves of `opening`."""
    if r.round_overlap != 0.0:
        corner = r.round_overlap * r.round_overlap
        above, below = opening - r.overlap, opening + r.overlap
        return opening + 0.5 * (sqrt(above * above + corner) - sqrt(below * below + corner))
    if opening > r.overlap:
        return opening - r.overlap
    lap = r.overlap * (1.0 - r.uneven_overlap)
    return opening + lap if opening < -lap else 0.0


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _underlapped(r, opening):
    """Return how far (m) an edge is open whose share of the spool's opening is `opening`."""
    if r.round_underlap != 0.0:
        corner = 2.0 * r.round_underlap
        return 0.5 * (opening + sqrt(opening * opening + corner * corner))
    if r.soft_underlap != 0.0:
        return max(0.0, opening) + r.soft_underlap * exp(-abs(opening) / r.soft_underlap)
    return max(0.0, r.underlap + opening)


@njit(cache=True, error_model="numpy", forceinline=True, **_PART)
def _bending(r, speed, bend, level):
    """Return the speed (m/s) at which the seals bend: LuGre, Bouc and Wen, or Dahl."""
    ratio = r.seal_stiffness * bend / level
    if r.dahl_exponent != 0.0:
        ahead = ratio if speed >= 0.0 else -ratio
        return speed * _power(1.0 - ahead, r.dahl_exponent)
    if r.bouc_exponent == 1.0 and r.bouc_share == 1.0:
        return speed - abs(speed) * r.seal_stiffness * bend / level
    power = abs(ratio) ** (r.bouc_exponent - 1.0)
    one_way = r.bouc_share * abs(speed) * power * ratio
    return speed - one_way - (1.0 - r.bouc_share) * speed * power * abs(ratio)


@njit(cache=True, error_model="numpy", forceinline=True)
def slopes(r, clock, reference, y, out):
    """Write the time derivatives of the states `y` (see STATES) to `out`.

    Args:
        r: RigValues of the rig.
        clock: s since the recording began.
        reference: commanded spool position, m.
        y: (14,) states, SI; they are not changed. Negative chamber pressures count as 0.
        out: (14,) time derivatives of the states, SI per s; overwritten.
    """
    position, speed, bend = y[POSITION], y[SPEED], y[BEND]
    p1, p2 = max(0.0, y[P1]), max(0.0, y[P2])
    tank, supply = y[TANK], y[SUPPLY]
    if r.ripple != 0.0:
        angle = 2.0 * pi * r.ripple_frequency * clock + r.ripple_phase
        if r.ripple_rectified != 0.0:
            # The fundamental of a rectified sine has the amplitude 4/(3 pi).
            wave = abs(sin(0.5 * angle + 0.25 * pi)) - 2.0 / pi
            supply += r.ripple * wave * 0.75 * pi
        else:
            supply += r.ripple * sin(angle)
    tone = 0.0
    if r.tone_frequency != 0.0:
        tone = sin(2.0 * pi * r.tone_frequency * clock + r.tone_phase)
    supply += r.tone_supply * tone

    # Spool, behind its pilot stage.
    target = reference
    if r.pilot_frequency > 0.0:
        target = y[PILOT]
        out[PILOT] = y[PILOT_SPEED]
        out[PILOT_SPEED] = r.pilot_frequency * (
            r.pilot_frequency * (reference - y[PILOT]) - 2.0 * r.pilot_damping * y[PILOT_SPEED]
        )
    else:
        out[PILOT], out[PILOT_SPEED] = 0.0, 0.0
    target += r.tone_spool * tone
    spool_speed = min(max(y[SPOOL_SPEED], -r.spool_speed), r.spool_speed)
    push = r.spool_frequency * (
        r.spool_frequency * (target - y[SPOOL]) - 2.0 * r.spool_damping * spool_speed
    )
    if (spool_speed >= r.spool_speed and push > 0.0) or (
        spool_speed <= -r.spool_speed and push < 0.0
    ):
        push = 0.0
    out[SPOOL] = spool_speed
    out[SPOOL_SPEED] = push
    if r.spool_soft_speed != 0.0:
        out[SPOOL] = r.spool_soft_speed * tanh(spool_speed / r.spool_soft_speed)
    if r.spool_order == 1.0:
        out[SPOOL], out[SPOOL_SPEED] = r.spool_frequency * (target - y[SPOOL]), 0.0

    # The valve has four metering edges: two open as the spool moves up, two as it moves down.
    opening = y[SPOOL] + r.null_shift + r.null_trend * clock
    if clock >= r.loose_at:
        opening += r.loose_null
    opening = _lapped(r, opening)
    conductance = r.edge_coefficient * r.edge_width * sqrt(2.0 / r.oil_density)
    up, down = conductance * _underlapped(r, opening), conductance * _underlapped(r, -opening)
    supply_1, tank_2 = up * _root(supply - p1), up * _root(p2 - tank)
    tank_1, supply_2 = down * _root(p1 - tank), down * _root(supply - p2)
    loss = r.port_2_loss
    if r.port_2_reach != 0.0:
        loss *= tanh(abs(opening) / r.port_2_reach) / tanh(_WIDE_OPEN / r.port_2_reach)
    if r.port_2_tank_only == 0.0:
        supply_2 *= 1.0 - loss
    tank_2 *= 1.0 - loss

    # Chambers.
    across, out_1, out_2 = r.leak_across, r.leak_1, r.leak_2
    now = r.comes_every == 0.0 or (clock - r.opens_at) % r.comes_every < r.stays_for
    now = now and r.opens_moving * speed >= r.opens_moving * r.opens_moving
    if now and clock >= r.opens_at and p1 >= r.opens_above and position >= r.opens_beyond:
        grown = 1.0 if r.opens_over == 0.0 else min(1.0, (clock - r.opens_at) / r.opens_over)
        across, out_1 = across + grown * r.opening_leak_across, out_1 + grown * r.opening_leak_1
        out_2 += grown * r.opening_leak_2
    if r.worn_leak != 0.0 or r.worn_leak_1 != 0.0 or r.worn_leak_2 != 0.0:
        wear = _bump(position, r.worn_place, r.worn_width)
        across += r.worn_leak * wear
        out_1 += r.worn_leak_1 * wear
        out_2 += r.worn_leak_2 * wear
    leak = lost_1 = lost_2 = 0.0
    if across != 0.0 or r.leak_across_linear != 0.0:
        leak = _leak(r, across, r.leak_across_linear, p1 - p2)
    if r.cross_relief != 0.0:
        leak += r.cross_relief * (
            max(0.0, p1 - p2 - r.cross_pressure) - max(0.0, p2 - p1 - r.cross_pressure)
        )
    if r.relief_leak != 0.0:
        lost_1, lost_2 = _relief(r, p1, 1.0), _relief(r, p2, 2.0)
    if out_1 != 0.0 or r.leak_1_linear != 0.0:
        lost_1 += _leak(r, out_1, r.leak_1_linear, p1 - tank)
    if out_2 != 0.0 or r.leak_2_linear != 0.0:
        lost_2 += _leak(r, out_2, r.leak_2_linear, p2 - tank)
    drawn, returned = supply_1 + supply_2, tank_1 + tank_2 + lost_1 + lost_2
    out[POCKET] = ((p1 if r.pocket_1 != 0.0 else p2) - y[POCKET]) / r.pocket_lag
    lost_1 += r.pocket_1 * out[POCKET] + r.tone_flow_1 * tone
    lost_2 += r.pocket_2 * out[POCKET] + r.tone_flow_2 * tone
    volume_1 = r.dead_volume + r.ram_area * position
    volume_2 = r.dead_volume + r.ram_area * (0.6069 - position)
    out[P1] = (supply_1 - tank_1 - leak - lost_1 - r.ram_area * speed) / (
        volume_1 * _compliance(r, p1, clock)
    )
    out[P2] = (supply_2 - tank_2 + leak - lost_2 + r.ram_area * speed) / (
        volume_2 * _compliance(r, p2, clock)
    )

    # Lines.
    droop, rise = drawn * abs(drawn), returned * abs(returned)
    if r.droop_exponent != 2.0:
        droop = _AMPLE_FLOW**2 * _power(drawn / _AMPLE_FLOW, r.droop_exponent)
    if r.rise_exponent != 2.0:
        rise = _AMPLE_FLOW**2 * _power(returned / _AMPLE_FLOW, r.rise_exponent)
    out[SUPPLY] = (r.pump_pressure - r.pump_droop * droop - y[SUPPLY]) / r.line_lag
    out[TANK] = (r.tank_rise * rise - tank) / r.line_lag

    # Ram on its seals (LuGre; Canudas de Wit et al. 1995), and what hangs on it.
    bending = _bending(r, speed, bend, slip_force(r, position, speed, p1, p2))
    sliding = speed / r.seal_damping_speed
    drag = r.drag + r.drag_square * abs(speed)
    if r.drag_exponent != 1.0:
        drag *= (max(abs(speed), 1e-9) / _BRISK) ** (r.drag_exponent - 1.0)
    if r.rough_drag != 0.0:
        drag += r.rough_drag * _bump(position, r.tight_place, r.tight_width)
    friction = r.seal_stiffness * bend + drag * speed
    if r.direction_drag != 0.0:
        friction += r.direction_drag * abs(speed)
    if abs(sliding) < 6.0:
        friction += r.seal_damping * exp(-sliding * sliding) * bending
    pull = -r.tone_force * tone
    if r.hung_mass != 0.0:
        back = r.hung_frequency * (
            r.hung_frequency * y[HUNG] + 2.0 * r.hung_damping * y[HUNG_SPEED]
        )
        pull += r.hung_mass * back
    out[POSITION] = speed
    out[BEND] = bending
    out[SPEED] = (
        r.ram_area * (p1 - p2) - friction - _outside_force(r, clock, position, speed) + pull
    ) / r.ram_mass
    out[HUNG] = out[HUNG_SPEED] = 0.0
    if r.hung_mass != 0.0:
        out[HUNG] = y[HUNG_SPEED]
        out[HUNG_SPEED] = -back - out[SPEED]


@njit(cache=True, error_model="numpy", **_PART)
def _held(command, tick, begin, end):
    """Return the mean command (V) between two moments, if each command is held for one tick.

    Args:
        command: (n,) V by tick.
        tick: the present tick; later commands are not used.
        begin: first moment, in ticks from the first row; before that row the command is 0 V.
        end: second moment, in the same unit, at most one tick later.
    """
    first, last = floor(begin), min(floor(end), tick)
    early = command[first] if first >= 0 else 0.0
    if last <= first:
        return early
    share = (last - begin) / (end - begin)
    return share * early + (1.0 - share) * (command[last] if last >= 0 else 0.0)


@njit(cache=True, error_model="numpy", **_PART)
def _follow(held, moved, slack):
    """Return the new position of a part that another part moves with play (backlash).

    Args:
        held: position of the part before.
        moved: new position of the part that moves it.
        slack: play on each side.
    """
    return min(max(held, moved - slack), moved + slack)


@njit(cache=True, error_model="numpy", **_PART)
def _bent(ratio, travel):
    """Return the new state of a smooth hysteresis, from -1 to 1, after a travel in units of reach.

    It is the law of Bouc and Wen (Wen 1976) with n = 2 and beta = gamma, which is solved exactly:
    even on the way back to zero, as a hyperbolic tangent from there on.
    """
    sign = 1.0 if travel >= 0.0 else -1.0
    ratio *= sign
    left = abs(travel)
    if ratio < 0.0:
        back = min(left, -ratio)
        ratio += back
        left -= back
    if left > 0.0:
        ratio = tanh(atanh(min(ratio, 1.0 - 1e-12)) + left)
    return sign * ratio


@njit(cache=True, error_model="numpy")
def run(r, setpoint, feed, gain, first, lead, noise, lateness, y, steps):
    """Simulate the rig with its position loop, and read its sensors once a tick (1 ms).

    The command is limited to `r.volts` and rounded to microvolts; pressures are never read below 0.

    Args:
        r: RigValues of the rig.
        setpoint: (n,) m.
        feed: (n,) V, added to the command of the position loop.
        gain: (n,) V/m of the position loop; 0 means open loop.
        first: row at which the simulation begins. Of the earlier rows only `feed` is used, as
            commands that a delay may bring to act later.
        lead: row at which the clock of those effects that change with time is zero.
        noise: (n, 3) noise of pressures 1 and 2 (Pa) and of the spool (m).
        lateness: (n,) random numbers from 0 to 1, by which `dead_time_jitter` is multiplied.
        y: (14,) states at row `first`; updated in place to those after the last tick.
        steps: integration steps in a tick.

    Returns:
        The readings (n, 5), see READINGS, and the states (n, 14) at the same moments. Rows before
        `first` are not filled.
    """
    n = setpoint.shape[0]
    readings, truth = np.empty((n, 5)), np.empty((n, _STATES))
    command = feed.copy()
    k, probe = np.empty((3, _STATES)), np.empty(_STATES)
    h = TICK / steps
    lag = 1.0 - exp(-h / r.gauge_lag) if r.gauge_lag > 0.0 else 1.0
    kept = _LONGEST_DELAY * steps
    seen = np.full(kept, y[POSITION])
    behind = r.encoder_delay / h
    felt, gauge_1, gauge_2, step = y[POSITION], max(0.0, y[P1]), max(0.0, y[P2]), 0
    shown_1, shown_2, rate_1, rate_2 = gauge_1, gauge_2, 0.0, 0.0
    natural = 2.0 * r.gauge_damping / r.gauge_lag if r.gauge_lag > 0.0 else 0.0
    bent_encoder, bent_spool, before, was, filtered = 0.0, 0.0, 0.0, y[POSITION], y[POSITION]
    silted, rested = False, 0
    reference = r.spool_per_volt * (feed[first - 1] if first > 0 else 0.0)
    for tick in range(first, n):
        # Sensors.
        whole = floor(behind)
        later, earlier = seen[(step - whole) % kept], seen[(step - whole - 1) % kept]
        place = later + (behind - whole) * (earlier - later)
        wave = r.encoder_wave * sin(2.0 * pi * place / r.encoder_pitch + r.encoder_phase)
        place = (r.encoder_gain + r.encoder_curve * place) * place + wave
        readings[tick, 1] = COUNT * np.rint(place / COUNT)
        shown_1 = _follow(shown_1, gauge_1, r.gauge_1_play)
        shown_2 = _follow(shown_2, gauge_2, r.gauge_2_play)
        gain_1 = r.gauge_1_gain + r.gauge_1_curve * shown_1
        gain_2 = r.gauge_2_gain + r.gauge_2_curve * shown_2
        readings[tick, 2] = max(0.0, gain_1 * shown_1 + r.gauge_1_bias + noise[tick, 0])
        readings[tick, 3] = max(0.0, gain_2 * shown_2 + r.gauge_2_bias + noise[tick, 1])
        readings[tick, 4] = y[SPOOL] + noise[tick, 2]
        for j in range(_STATES):
            truth[tick, j] = y[j]

        # The position loop rounds its command to microvolts, as recordings hold it.
        asked = gain[tick] * (setpoint[tick] - readings[tick, 1]) + feed[tick]
        command[tick] = np.rint(1e6 * min(max(asked, -r.volts), r.volts)) * 1e-6
        readings[tick, 0] = command[tick]

        late = (r.dead_time + r.dead_time_jitter * lateness[tick]) / TICK
        late += tick % r.hold_ticks
        for i in range(steps):
            clock = (tick - lead + i / steps) * TICK
            begin = tick + i / steps - late
            asked = _held(command, tick, begin, begin + 1.0 / steps)
            asked = r.spool_per_volt * min(max(asked, -r.amplifier_volts), r.amplifier_volts)
            asked *= 1.0 - r.valve_heat * max(0.0, clock)
            if r.spool_loop != 0.0:
                bent_spool = _bent(bent_spool, (asked - before) / r.spool_loop_reach)
                before = asked
                asked -= r.spool_loop * bent_spool
            if r.silt != 0.0:
                away = abs(asked - reference)
                rested = rested + 1 if away < 0.01 * r.silt else 0
                silted = (silted or rested * h > _SILTING) and away < r.silt
                asked = reference if silted else asked
            reference = _follow(reference, asked, r.spool_play)
            for j in range(_STATES):
                probe[j] = y[j]
            for stage in range(3):
                slopes(r, clock + 0.5 * stage * h, reference, probe, k[stage])
                for j in range(_STATES):
                    if stage == 0:
                        probe[j] = y[j] + 0.5 * h * k[0, j]
                    else:
                        probe[j] = y[j] + h * (2.0 * k[1, j] - k[0, j])
            for j in range(_STATES):
                y[j] += h / 6.0 * (k[0, j] + 4.0 * k[1, j] + k[2, j])
            y[SPOOL_SPEED] = min(max(y[SPOOL_SPEED], -r.spool_speed), r.spool_speed)
            left_1, left_2 = max(0.0, y[P1]) - gauge_1, max(0.0, y[P2]) - gauge_2
            if r.gauge_damping != 0.0:
                rate_1 += h * natural * (natural * left_1 - 2.0 * r.gauge_damping * rate_1)
                rate_2 += h * natural * (natural * left_2 - 2.0 * r.gauge_damping * rate_2)
                gauge_1 += h * rate_1
                gauge_2 += h * rate_2
            else:
                gauge_1 += lag * left_1
                gauge_2 += lag * left_2
            felt = _follow(felt, y[POSITION], 0.5 * r.encoder_play)
            if r.encoder_loop != 0.0:
                bent_encoder = _bent(bent_encoder, (y[POSITION] - was) / r.encoder_loop_reach)
                was = y[POSITION]
                felt = was - r.encoder_loop * bent_encoder
            filtered = (
                felt if r.encoder_lag == 0.0 else filtered + h / r.encoder_lag * (felt - filtered)
            )
            step += 1
            seen[step % kept] = filtered
    return readings, truth
