"""The equations of the independent rig, their integration and its sensors, compiled.

The integrator is deliberately simpler than the product's: Kutta's third-order method with steps of
20 us. All compiled functions are in this one file, because numba's cache recompiles a function only
if the function's own file changed.
"""

from math import exp, floor, pi, sin, sqrt
from typing import Final

import numpy as np
from numba import njit  # noqa: TID251 (this simulator imports nothing of the product)

TICK: Final = 1e-3
"""s: time between two samples."""
STEPS: Final = 50
"""Integration steps in a tick; each is 20 us long."""
STATES: Final = (
    "spool", "spool_speed", "pilot", "pilot_speed", "position", "speed", "seal_bend",
    "pressure_1", "pressure_2", "supply", "tank",
)  # fmt: skip
SPOOL, SPOOL_SPEED, PILOT, PILOT_SPEED, POSITION, SPEED, BEND, P1, P2, SUPPLY, TANK = range(11)
COUNT: Final = 3e-5
"""m: length of one encoder count."""
READINGS: Final = ("command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")

_ATMOSPHERE: Final = 1.01325e5
_LONGEST_DELAY: Final = 64


@njit(cache=True, error_model="numpy")
def _root(pressure):
    """Return the square root of the magnitude of `pressure`, with the sign of `pressure`."""
    return sqrt(pressure) if pressure >= 0.0 else -sqrt(-pressure)


@njit(cache=True, error_model="numpy")
def _bump(place, middle, width):
    """Return exp(-((place - middle) / width)^2): 1 at `middle`, and nearly 0 far from it."""
    distance = (place - middle) / width
    return exp(-distance * distance)


@njit(cache=True, error_model="numpy")
def _compliance(r, pressure, clock):
    """Return the compliance of liquid and air bubbles together, 1/Pa (Merritt 1967, ch. 1)."""
    liquid = 1.0 / (r.oil_stiffness * (1.0 - r.oil_trend * clock))
    absolute = pressure + _ATMOSPHERE
    return liquid + r.air * _ATMOSPHERE / (absolute * absolute)


@njit(cache=True, error_model="numpy")
def _relief(r, pressure):
    """Return the flow (m^3/s) out of a chamber through a relief valve that does not close."""
    return r.relief_leak * max(0.0, pressure - r.relief_pressure)


@njit(cache=True, error_model="numpy")
def slip_force(r, position, speed, pressure_1):
    """Return the friction (N) at which the seals slip: Stribeck's curve with the hidden effects.

    It is 10 N at least, and never negative; the sign of the speed chooses the part that depends on
    the direction. `r` holds the `RigValues`; position is in m, speed in m/s, pressure in Pa.
    """
    level = r.sliding + (r.break_away - r.sliding) * exp(-abs(speed) / r.stribeck)
    if speed > 0.0:
        level += r.direction_friction
    elif speed < 0.0:
        level -= r.direction_friction
    if r.tight_spot != 0.0:
        level += r.tight_spot * _bump(position, r.tight_place, r.tight_width)
    return max(10.0, level + r.squeeze * pressure_1 * pressure_1)


@njit(cache=True, error_model="numpy")
def _outside_force(r, position, speed):
    """Return the external force (N) against extension: spring, stroke ends, weight, cogging."""
    force = r.push_back + r.spring * max(0.0, position - r.spring_contact)
    beyond = position - r.stroke_high
    if beyond > 0.0:
        force += r.stop_stiffness * beyond * max(0.0, 1.0 + r.stop_loss * speed)
    short = r.stroke_low - position
    if short > 0.0:
        force -= r.stop_stiffness * short * max(0.0, 1.0 - r.stop_loss * speed)
    if r.cogging != 0.0:
        force += r.cogging * sin(2.0 * pi * position / r.cogging_pitch)
    return force


@njit(cache=True, error_model="numpy")
def slopes(r, clock, reference, y, out):
    """Write the time derivatives of the states `y` (see STATES) to `out`.

    Args:
        r: RigValues of the rig.
        clock: s since the recording began.
        reference: commanded spool position, m.
        y: (11,) states, SI; they are not changed. Negative chamber pressures count as 0.
        out: (11,) time derivatives of the states, SI per s; overwritten.
    """
    position, speed, bend = y[POSITION], y[SPEED], y[BEND]
    p1, p2 = max(0.0, y[P1]), max(0.0, y[P2])
    tank = y[TANK]
    supply = y[SUPPLY]
    if r.ripple != 0.0:
        supply += r.ripple * sin(2.0 * pi * r.ripple_frequency * clock + r.ripple_phase)

    # Spool, behind its pilot stage.
    target = reference
    if r.pilot_frequency > 0.0:
        target = y[PILOT]
        out[PILOT] = y[PILOT_SPEED]
        out[PILOT_SPEED] = r.pilot_frequency * (
            r.pilot_frequency * (reference - y[PILOT]) - 2.0 * r.pilot_damping * y[PILOT_SPEED]
        )
    else:
        out[PILOT] = 0.0
        out[PILOT_SPEED] = 0.0
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

    # The valve has four metering edges: two open as the spool moves up, two as it moves down.
    opening = y[SPOOL] + r.null_shift + r.null_trend * clock
    if opening > r.overlap:
        opening -= r.overlap
    elif opening < -r.overlap:
        opening += r.overlap
    else:
        opening = 0.0
    conductance = r.edge_coefficient * r.edge_width * sqrt(2.0 / r.oil_density)
    supply_1 = supply_2 = tank_1 = tank_2 = 0.0
    if opening > -r.underlap:
        edge = conductance * (r.underlap + opening)
        supply_1, tank_2 = edge * _root(supply - p1), edge * _root(p2 - tank)
    if opening < r.underlap:
        edge = conductance * (r.underlap - opening)
        tank_1, supply_2 = edge * _root(p1 - tank), edge * _root(supply - p2)
    supply_2 *= 1.0 - r.port_2_loss
    tank_2 *= 1.0 - r.port_2_loss

    # Chambers.
    across, out_1, out_2 = r.leak_across, r.leak_1, r.leak_2
    if clock >= r.opens_at:
        across += r.opening_leak_across
        out_1 += r.opening_leak_1
        out_2 += r.opening_leak_2
    if r.worn_leak != 0.0:
        across += r.worn_leak * _bump(position, r.worn_place, r.worn_width)
    leak = across * _root(p1 - p2) if across != 0.0 else 0.0
    lost_1, lost_2 = _relief(r, p1), _relief(r, p2)
    if out_1 != 0.0:
        lost_1 += out_1 * _root(p1 - tank)
    if out_2 != 0.0:
        lost_2 += out_2 * _root(p2 - tank)
    volume_1 = r.dead_volume + r.ram_area * position
    volume_2 = r.dead_volume + r.ram_area * (0.6069 - position)
    out[P1] = (supply_1 - tank_1 - leak - lost_1 - r.ram_area * speed) / (
        volume_1 * _compliance(r, p1, clock)
    )
    out[P2] = (supply_2 - tank_2 + leak - lost_2 + r.ram_area * speed) / (
        volume_2 * _compliance(r, p2, clock)
    )

    # Lines.
    drawn, returned = supply_1 + supply_2, tank_1 + tank_2 + lost_1 + lost_2
    out[SUPPLY] = (r.pump_pressure - r.pump_droop * drawn * abs(drawn) - y[SUPPLY]) / r.line_lag
    out[TANK] = (r.tank_rise * returned * abs(returned) - tank) / r.line_lag

    # Ram on its seals (LuGre; Canudas de Wit et al. 1995).
    bending = speed - abs(speed) * r.seal_stiffness * bend / slip_force(r, position, speed, p1)
    sliding = speed / r.seal_damping_speed
    friction = r.seal_stiffness * bend + (r.drag + r.drag_square * abs(speed)) * speed
    if abs(sliding) < 6.0:
        friction += r.seal_damping * exp(-sliding * sliding) * bending
    out[POSITION] = speed
    out[BEND] = bending
    out[SPEED] = (
        r.ram_area * (p1 - p2) - friction - _outside_force(r, position, speed)
    ) / r.ram_mass


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _follow(held, moved, slack):
    """Return the new position of a part that another part moves with play (backlash).

    Args:
        held: position of the part before.
        moved: new position of the part that moves it.
        slack: play on each side.
    """
    return min(max(held, moved - slack), moved + slack)


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
        y: (11,) states at row `first`; updated in place to those after the last tick.
        steps: integration steps in a tick.

    Returns:
        The readings (n, 5), see READINGS, and the states (n, 11) at the same moments. Rows before
        `first` are not filled.
    """
    n = setpoint.shape[0]
    readings, truth = np.empty((n, 5)), np.empty((n, 11))
    command = np.empty(n)
    k1, k2, k3, probe = np.empty(11), np.empty(11), np.empty(11), np.empty(11)
    h = TICK / steps
    lag = 1.0 - exp(-h / r.gauge_lag) if r.gauge_lag > 0.0 else 1.0
    kept = _LONGEST_DELAY * steps
    seen = np.full(kept, y[POSITION])
    behind = r.encoder_delay / h
    felt, gauge_1, gauge_2, step = y[POSITION], max(0.0, y[P1]), max(0.0, y[P2]), 0
    reference = r.spool_per_volt * (feed[first - 1] if first > 0 else 0.0)
    command[:first] = feed[:first]
    for tick in range(first, n):
        # Sensors.
        whole = floor(behind)
        later, earlier = seen[(step - whole) % kept], seen[(step - whole - 1) % kept]
        place = later + (behind - whole) * (earlier - later)
        place = r.encoder_gain * place + r.encoder_wave * sin(2.0 * pi * place / r.encoder_pitch)
        readings[tick, 1] = COUNT * np.rint(place / COUNT)
        readings[tick, 2] = max(0.0, r.gauge_1_gain * gauge_1 + r.gauge_1_bias + noise[tick, 0])
        readings[tick, 3] = max(0.0, r.gauge_2_gain * gauge_2 + r.gauge_2_bias + noise[tick, 1])
        readings[tick, 4] = y[SPOOL] + noise[tick, 2]
        truth[tick] = y

        # The position loop rounds its command to microvolts, as recordings hold it.
        asked = gain[tick] * (setpoint[tick] - readings[tick, 1]) + feed[tick]
        command[tick] = np.rint(1e6 * min(max(asked, -r.volts), r.volts)) * 1e-6
        readings[tick, 0] = command[tick]

        late = (r.dead_time + r.dead_time_jitter * lateness[tick]) / TICK
        for i in range(steps):
            clock = (tick - lead + i / steps) * TICK
            begin = tick + i / steps - late
            asked = r.spool_per_volt * _held(command, tick, begin, begin + 1.0 / steps)
            asked *= 1.0 - r.valve_heat * max(0.0, clock)
            reference = _follow(reference, asked, r.spool_play)
            slopes(r, clock, reference, y, k1)
            for j in range(11):
                probe[j] = y[j] + 0.5 * h * k1[j]
            slopes(r, clock + 0.5 * h, reference, probe, k2)
            for j in range(11):
                probe[j] = y[j] + h * (2.0 * k2[j] - k1[j])
            slopes(r, clock + h, reference, probe, k3)
            for j in range(11):
                y[j] += h / 6.0 * (k1[j] + 4.0 * k2[j] + k3[j])
            y[SPOOL_SPEED] = min(max(y[SPOOL_SPEED], -r.spool_speed), r.spool_speed)
            gauge_1 += lag * (max(0.0, y[P1]) - gauge_1)
            gauge_2 += lag * (max(0.0, y[P2]) - gauge_2)
            felt = _follow(felt, y[POSITION], 0.5 * r.encoder_play)
            step += 1
            seen[step % kept] = felt
    return readings, truth
