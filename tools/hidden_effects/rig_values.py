"""All parameters of the independent rig: the corrected table 2.1, and those of hidden effects."""

from math import pi
from typing import NamedTuple


class RigValues(NamedTuple):
    """The parameters of one rig, in SI; the defaults describe a rig without any hidden effect.

    The first block is the thesis's table 2.1 with C_d = 0.6 and k_sp in m/V, and the bristle law
    from the corrections to it. The second block holds the effects that are in the workflow's
    catalogue, the third their other formulas (`forms.py`), the fourth what is not in the catalogue,
    and the last one what opens or comes loose during a recording. At its default, each effect is
    absent and each formula is that of the catalogue.
    """

    # The rig.
    ram_area: float = 6.33e-4
    ram_mass: float = 10.0
    stroke_low: float = 0.0
    stroke_high: float = 0.6069
    dead_volume: float = 2.14e-5
    """m^3 on each side, including the line."""
    oil_stiffness: float = 689e6
    oil_density: float = 847.15
    pump_pressure: float = 13.8e6
    line_lag: float = 2e-3
    """s: time constant of the pressures in the lines at the valve."""
    edge_coefficient: float = 0.6
    edge_width: float = 2.075e-2
    spool_per_volt: float = 2.794e-5
    spool_frequency: float = 200.0 * pi
    spool_damping: float = 0.7
    break_away: float = 2400.0
    sliding: float = 1100.0
    stribeck: float = 0.04
    drag: float = 350.0
    seal_stiffness: float = 2e7
    seal_damping: float = 2e4
    seal_damping_speed: float = 0.01
    stop_stiffness: float = 6e7
    stop_loss: float = 5.0
    """s/m: share by which the stop's force grows for each m/s of approach, or falls in leaving."""
    volts: float = 10.0
    """V: the greatest command, in either direction."""

    # Effects on the menu.
    null_shift: float = 0.0
    overlap: float = 0.0
    underlap: float = 0.0
    port_2_loss: float = 0.0
    spool_play: float = 0.0
    spool_speed: float = 1e9
    dead_time: float = 0.0
    air: float = 0.0
    pump_droop: float = 0.0
    tank_rise: float = 0.0
    ripple: float = 0.0
    ripple_frequency: float = 0.0
    ripple_phase: float = 0.0
    direction_friction: float = 0.0
    leak_across: float = 0.0
    leak_1: float = 0.0
    leak_2: float = 0.0
    spring: float = 0.0
    spring_contact: float = 0.0
    push_back: float = 0.0
    gauge_1_bias: float = 0.0
    gauge_2_bias: float = 0.0
    gauge_1_gain: float = 1.0
    gauge_2_gain: float = 1.0
    gauge_lag: float = 0.0
    encoder_gain: float = 1.0
    encoder_delay: float = 0.0
    encoder_play: float = 0.0

    # Other formulas of effects on the menu; `forms.py` tells the source of each.
    stribeck_exponent: float = 1.0
    hess_soom: float = 0.0
    """1: Stribeck's curve falls as 1/(1 + (v/vs)^2) instead of as an exponential."""
    level_by_pressure: float = 0.0
    """N/Pa: friction that grows with the pressure across the piston."""
    dahl_exponent: float = 0.0
    """Of Dahl's law for the seals; 0 means another law."""
    bouc_exponent: float = 1.0
    bouc_share: float = 1.0
    """Share beta of beta + gamma = 1 in Bouc and Wen's law; 1 and 1 make it the LuGre law."""
    soft_underlap: float = 0.0
    """m: how far each edge is open at null, if that fades as exp(-|x|/u)."""
    round_underlap: float = 0.0
    """m: the same, if the edge is rounded."""
    round_overlap: float = 0.0
    """m: how far the corner of an overlap is rounded."""
    uneven_overlap: float = 0.0
    """Share by which the overlap is smaller on the side of negative openings."""
    port_2_reach: float = 0.0
    """m: opening at which `port_2_loss` has nearly come up; 0 means that it is always there."""
    port_2_tank_only: float = 0.0
    """1: `port_2_loss` is one of the edge to the tank alone."""
    spool_loop: float = 0.0
    """m: half width of a smooth hysteresis of the spool, which comes up over `spool_loop_reach`."""
    spool_loop_reach: float = 1.0
    spool_order: float = 2.0
    spool_soft_speed: float = 0.0
    """m/s: speed that the spool nears as a hyperbolic tangent; 0 means no such speed."""
    hold_ticks: float = 1.0
    """Ticks for which each command that passes is held; the others do not pass."""
    air_exponent: float = 1.0
    """Polytropic exponent of the bubbles."""
    air_gone: float = 0.0
    """Pa: pressure at which all air is dissolved; 0 means that none dissolves."""
    stiffening: float = 0.0
    """1: the oil's stiffness grows with the logarithm of its pressure."""
    droop_exponent: float = 2.0
    rise_exponent: float = 2.0
    ripple_rectified: float = 0.0
    """1: the ripple is a rectified sine, whose fundamental has the amplitude `ripple`."""
    direction_drag: float = 0.0
    """N s/m: drag that is more when extending and less when retracting."""
    drag_exponent: float = 1.0
    leak_across_linear: float = 0.0
    """m^3/(s Pa), as the two below."""
    leak_1_linear: float = 0.0
    leak_2_linear: float = 0.0
    leak_transition: float = 0.0
    """Pa: pressure drop below which the leaks are laminar and above which they are turbulent."""
    spring_hardening: float = 0.0
    """m: travel at which the spring's force is twice that of a linear one; 0 means linear."""
    stop_exponent: float = 1.0
    stop_damping: float = 0.0
    """N s/m, in place of `stop_loss`; 0 means none."""
    gauge_1_curve: float = 0.0
    """1/Pa: share of its reading that a gauge shows too much, for each Pa that it reads."""
    gauge_2_curve: float = 0.0
    encoder_curve: float = 0.0
    """1/m, likewise."""
    gauge_damping: float = 0.0
    """Damping ratio of gauges of second order; 0 means first order."""
    encoder_lag: float = 0.0
    """s: time constant of a filter after the encoder."""
    encoder_loop: float = 0.0
    """m: half width of a play with soft contact, which is taken up over `encoder_loop_reach`."""
    encoder_loop_reach: float = 1.0

    # Effects off the menu.
    tight_spot: float = 0.0
    """N of additional friction at `tight_place` (m), fading over `tight_width` (m)."""
    tight_place: float = 0.0
    tight_width: float = 1.0
    pilot_frequency: float = 0.0
    """rad/s: frequency of a weakly damped pilot stage ahead of the spool; 0 means no such stage."""
    pilot_damping: float = 0.1
    oil_trend: float = 0.0
    """1/s: share of the stiffness that the oil loses in each second while it warms."""
    cogging: float = 0.0
    """N: amplitude of a force that alternates along the stroke with period `cogging_pitch` (m)."""
    cogging_pitch: float = 1.0
    cogging_phase: float = 0.0
    squeeze: float = 0.0
    """N/Pa^2: additional friction for each Pa^2 of the squared pressure in chamber 1."""
    squeeze_2: float = 0.0
    """The same for chamber 2."""
    null_trend: float = 0.0
    """m/s: speed at which the spool's null drifts."""
    worn_leak: float = 0.0
    """m^3/(s sqrt Pa): leak across the piston at `worn_place` (m), fading over `worn_width` (m)."""
    worn_leak_1: float = 0.0
    """The same out of chamber 1."""
    worn_leak_2: float = 0.0
    worn_place: float = 0.0
    worn_width: float = 1.0
    relief_leak: float = 0.0
    """m^3/(s Pa): flow out of each chamber for each Pa of pressure above `relief_pressure` (Pa)."""
    relief_pressure: float = 0.0
    relief_only: float = 0.0
    """1 or 2: only this chamber has the relief valve; 0: both have."""
    drag_square: float = 0.0
    """N s^2/m^2: friction that grows with the square of the speed."""
    encoder_wave: float = 0.0
    """m: amplitude of an encoder error that is periodic in position with `encoder_pitch` (m)."""
    encoder_pitch: float = 1.0
    encoder_phase: float = 0.0
    dead_time_jitter: float = 0.0
    """s: each command is late by a random time between 0 and this, beside `dead_time`."""
    valve_heat: float = 0.0
    """1/s: share of the spool's travel per volt that is lost in each second."""
    hung_mass: float = 0.0
    """kg of a second mass that hangs on the ram by a spring."""
    hung_frequency: float = 100.0
    """rad/s of this mass on its spring, with the ram held."""
    hung_damping: float = 0.1
    cross_relief: float = 0.0
    """m^3/(s Pa): flow across the piston for each Pa of difference beyond `cross_pressure` (Pa)."""
    cross_pressure: float = 0.0
    rough_drag: float = 0.0
    """N s/m of additional drag at `tight_place`, fading over `tight_width`."""
    side_load: float = 0.0
    """N/m: additional friction for each metre that the ram is extended."""
    cushion: float = 0.0
    """N s^2/m^3: drag with the square of the speed, for each metre beyond `cushion_place` (m)."""
    cushion_place: float = 0.0
    pocket_1: float = 0.0
    """m^3/Pa: compliance of a pocket of air behind a narrow bore at chamber 1."""
    pocket_2: float = 0.0
    pocket_lag: float = 0.01
    """s: time constant with which the pocket fills."""
    silt: float = 0.0
    """m: how far the spool must be asked to go before one that has rested breaks loose."""
    amplifier_volts: float = 1e9
    """V: the greatest command that the valve's amplifier passes, in either direction."""
    gauge_1_play: float = 0.0
    """Pa: half width of the hysteresis of a pressure transducer."""
    gauge_2_play: float = 0.0
    gauge_1_drift: float = 0.0
    """Pa/s: speed at which the zero of a pressure transducer drifts."""
    gauge_2_drift: float = 0.0
    gauge_1_crosstalk: float = 0.0
    """Pa/V: what a pressure reading shows of the valve's command."""
    gauge_2_crosstalk: float = 0.0
    swapped_gauges: float = 0.0
    """1: the channels of the two pressures are mixed up."""
    tone_frequency: float = 0.0
    """Hz of a tone in time, whose phase (rad) differs from recording to recording."""
    tone_phase: float = 0.0
    tone_force: float = 0.0
    """N, amplitude; in the others m^3/s, m and Pa."""
    tone_flow_1: float = 0.0
    tone_flow_2: float = 0.0
    tone_spool: float = 0.0
    tone_supply: float = 0.0
    tone_gauge_1: float = 0.0
    tone_gauge_2: float = 0.0

    # What changes at one moment of a recording.
    opens_at: float = 1e9
    """s from the recording's first row to the moment at which the leaks below open."""
    opening_leak_1: float = 0.0
    """m^3/(s sqrt Pa) out of chamber 1."""
    opening_leak_2: float = 0.0
    opening_leak_across: float = 0.0
    opens_over: float = 0.0
    """s: how long these leaks grow in a straight line; 0 if they open at once."""
    comes_every: float = 0.0
    """s: period with which these leaks open again; 0 means that they stay open."""
    stays_for: float = 0.0
    """s: how long they then stay open."""
    opens_beyond: float = -1e9
    """m: they are open only while the ram is beyond this position."""
    opens_moving: float = 0.0
    """m/s: they are open only while the ram is faster than this in its direction; 0: always."""
    opens_above: float = -1e9
    """Pa: they are open only while chamber 1 is above this pressure."""
    loose_at: float = 1e9
    """s from the recording's first row to the moment at which the values below come up."""
    loose_force: float = 0.0
    """N against extension."""
    loose_null: float = 0.0
    """m by which the spool's null jumps."""
    loose_gauge_1: float = 0.0
    """Pa by which a pressure reading jumps."""
    loose_gauge_2: float = 0.0
    stuck_reading: float = 0.0
    """2 or 3: the reading of pressure 1 or 2 stays what it is at `loose_at`; 4: that of the spool;
    0: none does."""


TABLE = RigValues()
