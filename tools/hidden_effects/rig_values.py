"""Every value of the independent rig: table 2.1 as corrected, and what may be hidden."""

from math import pi
from typing import NamedTuple


class RigValues(NamedTuple):
    """What the simulator reads, in SI; the defaults are a rig with nothing hidden.

    The first block is the thesis's table 2.1 with C_d = 0.6 and k_sp in m/V, and the bristle law
    of the corrections to it. The second holds the effects that the workflow's catalogue has, the
    third those that it has not, the last leaks that open while a recording is made; all are absent
    at their defaults.
    """

    # The rig.
    ram_area: float = 6.33e-4
    ram_mass: float = 10.0
    stroke_low: float = 0.0
    stroke_high: float = 0.6069
    dead_volume: float = 2.14e-5
    """m^3, on each side, line included."""
    oil_stiffness: float = 689e6
    oil_density: float = 847.15
    pump_pressure: float = 13.8e6
    line_lag: float = 2e-3
    """s, in which the lines at the valve fill."""
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
    """s/m: share of the stop's force lost or gained for each m/s of approach."""
    volts: float = 10.0
    """The greatest command either way."""

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
    """N of friction on top, at `tight_place` (m), over `tight_width` (m)."""
    tight_place: float = 0.0
    tight_width: float = 1.0
    pilot_frequency: float = 0.0
    """rad/s of a second, hardly damped mode before the spool; 0: none."""
    pilot_damping: float = 0.1
    oil_trend: float = 0.0
    """1/s: share of its stiffness that the oil loses each second as it warms."""
    cogging: float = 0.0
    """N of a force that alternates along the stroke, once each `cogging_pitch` (m)."""
    cogging_pitch: float = 1.0
    squeeze: float = 0.0
    """N of friction on top for each Pa^2 that chamber 1 presses its seal with."""
    null_trend: float = 0.0
    """m/s by which the spool's null drifts."""
    worn_leak: float = 0.0
    """m^3/(s sqrt Pa) across the piston, at `worn_place` (m), over `worn_width` (m)."""
    worn_place: float = 0.0
    worn_width: float = 1.0
    relief_leak: float = 0.0
    """m^3/(s Pa) out of each chamber for what its pressure exceeds `relief_pressure` (Pa)."""
    relief_pressure: float = 0.0
    drag_square: float = 0.0
    """N s^2/m^2."""
    encoder_wave: float = 0.0
    """m of an error of the encoder that repeats each `encoder_pitch` (m)."""
    encoder_pitch: float = 1.0
    dead_time_jitter: float = 0.0
    """s up to which each command is late, at random."""
    valve_heat: float = 0.0
    """1/s: share by which each volt moves the spool less, each second."""

    # Leaks that open within a recording.
    opens_at: float = 1e9
    """s since the recording began."""
    opening_leak_1: float = 0.0
    """m^3/(s sqrt Pa), out of chamber 1."""
    opening_leak_2: float = 0.0
    opening_leak_across: float = 0.0


TABLE = RigValues()
