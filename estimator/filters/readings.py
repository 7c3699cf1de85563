"""Corrections for the modelled effects between rig and filter: transducers, command path, lines.

Filters and accounts use only these functions to turn readings into true values and a command into
the command that acts on the spool. For a model without effects all of them change nothing, to the
last bit.

Some effects are not corrected. The inverse of `pressure_lag` would multiply the noise by lag over
tick. A correction of `position_delay` by the estimated velocity would feed that velocity back and
diverge at 5 ms. With `position_backlash`, one sample does not show on which side of the play the
encoder is. A `supply_ripple` is seen by the transducer, and its phase on a rig is unknown.
"""

from rig.lanes import select
from rig.plant import (
    TICK,
    command_through_play,
    delayed_command,
    inlined,
    inner,
    lapped,
    valve_conductance,
)


@inlined
def true_pressures(p1, p2, par):
    """Return the true pressures of both chambers in Pa from readings: (reading - bias) / gain."""
    return (
        (p1 - par.pressure_1_bias) / par.pressure_1_gain,
        (p2 - par.pressure_2_bias) / par.pressure_2_gain,
    )


@inlined
def true_position(position, par):
    """Return the true position in m from a reading: reading / gain."""
    return position / par.position_gain


@inner
def acting_command(path, command, par):
    """Return the mean command in V that acts on the spool over a tick, after delay and play.

    Args:
        path: memory of the command path (`rig.plant.command_effects`), updated.
        command: command sent for this tick, V.
        par: the `Parameters` that are assumed.
    """
    if par.command_delay != 0.0:
        before, after, late = delayed_command(path, command, par.command_delay)
        command = after + (before - after) * (late / TICK)
    return command_through_play(path, command, par)


@inlined
def _loss(opening, drop, restriction, par):
    """Return the pressure loss in Pa of a line in series with an open edge of the valve.

    It follows from q^2 = c^2 y^2 (drop - R q^2), with c the conductance of the valve.

    Args:
        opening: opening y of the valve, null bias included, m.
        drop: pressure drop over line and edge together, not negative, Pa.
        restriction: R of the line, Pa/(m^3/s)^2.
        par: the `Parameters` that are assumed.
    """
    passed = valve_conductance(par) * (abs(lapped(opening, par)) + par.valve_underlap_leakage)
    square = passed * passed
    return restriction * square * drop / (1.0 + restriction * square)


@inlined
def settled_supply(opening, p1, p2, par):
    """Return the supply pressure in Pa at the valve once its line is settled.

    The droop of the line at the valve's flow is taken off (Merritt 1967, ch. 3). The opening (m)
    includes the null bias; p1 and p2 are the chamber pressures in Pa.
    """
    supply = par.supply_pressure
    if par.supply_droop == 0.0:
        return supply
    drop = max(supply - select(opening >= 0.0, p1, p2), 0.0)
    return supply - _loss(opening, drop, par.supply_droop, par)


@inlined
def settled_return(opening, p1, p2, par):
    """Return the return pressure in Pa at the valve once its line is settled.

    The back pressure of the line at the valve's flow is added (Merritt 1967, ch. 3). The opening
    (m) includes the null bias; p1 and p2 are the chamber pressures in Pa.
    """
    back = par.return_pressure
    if par.return_back_pressure == 0.0:
        return back
    drop = max(select(opening >= 0.0, p2, p1) - back, 0.0)
    return back + _loss(opening, drop, par.return_back_pressure, par)
