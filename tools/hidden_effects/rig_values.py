"""All parameters of the independent rig: the corrected table 2.1, and those of hidden effects."""

from math import pi
from typing import NamedTuple


class RigValues(NamedTuple):
    """The parameters of one rig, in SI; the defaults describe a rig without any hidden effect.

    The first block is the thesis's table 2.1 with C_d = 0.6 and k_sp in m/V, and the bristle law
    from the corrections to it. The second block holds the effects that are in the workflow's
    catalogue, the third those that are not, and the last one leaks that open during a recording. At
    its default, each effect is absent.
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
    squeeze: float = 0.0
    """N/Pa^2: additional friction for each Pa^2 of the squared pressure in chamber 1."""
    null_trend: float = 0.0
    """m/s: speed at which the spool's null drifts."""
    worn_leak: float = 0.0
    """m^3/(s sqrt Pa): leak across the piston at `worn_place` (m), fading over `worn_width` (m)."""
    worn_place: float = 0.0
    worn_width: float = 1.0
    relief_leak: float = 0.0
    """m^3/(s Pa): flow out of each chamber for each Pa of pressure above `relief_pressure` (Pa)."""
    relief_pressure: float = 0.0
    drag_square: float = 0.0
    """N s^2/m^2: friction that grows with the square of the speed."""
    encoder_wave: float = 0.0
    """m: amplitude of an encoder error that is periodic in position with `encoder_pitch` (m)."""
    encoder_pitch: float = 1.0
    dead_time_jitter: float = 0.0
    """s: each command is late by a random time between 0 and this, beside `dead_time`."""
    valve_heat: float = 0.0
    """1/s: share of the spool's travel per volt that is lost in each second."""

    # Leaks that open within a recording.
    opens_at: float = 1e9
    """s from the recording's first row to the moment at which the leaks below open."""
    opening_leak_1: float = 0.0
    """m^3/(s sqrt Pa) out of chamber 1."""
    opening_leak_2: float = 0.0
    opening_leak_across: float = 0.0


TABLE = RigValues()
