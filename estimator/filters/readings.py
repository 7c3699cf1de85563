"""What the model says lies between rig and filter, undone: transducers, command path, lines.

The one place where filters and accounts turn readings into what they show of the rig, and a
command into what acts on the spool. For a model without effects all of it is the identity, to the
last bit.

Not undone: `pressure_lag` (its inverse would multiply the noise by lag over tick), `position_delay`
(a reading moved on by the estimated velocity feeds that back, and diverges at 5 ms),
`position_backlash` (which side of the play the encoder is on is not known from one sample) and
`supply_ripple` (a transducer shows it, and its phase is no rig's).
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
    """Return the pressures in Pa that readings show: (reading - bias) / gain."""
    return (
        (p1 - par.pressure_1_bias) / par.pressure_1_gain,
        (p2 - par.pressure_2_bias) / par.pressure_2_gain,
    )


@inlined
def true_position(position, par):
    """Return the position in m that a reading shows, scaled back."""
    return position / par.position_gain


@inner
def acting_command(path, command, par):
    """Return the command in V that acts on the spool over a tick, on the average.

    Args:
        path: memory (`rig.plant.command_effects`), updated.
        command: sent for this tick, V.
        par: the `Parameters` assumed.
    """
    if par.command_delay != 0.0:
        before, after, late = delayed_command(path, command, par.command_delay)
        command = after + (before - after) * (late / TICK)
    return command_through_play(path, command, par)


@inlined
def _loss(opening, drop, restriction, par):
    """Return what a line loses in Pa to the flow through an edge of the valve in series with it.

    From q^2 = c^2 y^2 (drop - R q^2), with the drop of both together.
    """
    passed = valve_conductance(par) * (abs(lapped(opening, par)) + par.valve_underlap_leakage)
    square = passed * passed
    return restriction * square * drop / (1.0 + restriction * square)


@inlined
def settled_supply(opening, p1, p2, par):
    """Return the supply pressure in Pa at the valve, its line settled (Merritt 1967, ch. 3)."""
    supply = par.supply_pressure
    if par.supply_droop == 0.0:
        return supply
    drop = max(supply - select(opening >= 0.0, p1, p2), 0.0)
    return supply - _loss(opening, drop, par.supply_droop, par)


@inlined
def settled_return(opening, p1, p2, par):
    """Return the return pressure in Pa at the valve, its line settled (Merritt 1967, ch. 3)."""
    back = par.return_pressure
    if par.return_back_pressure == 0.0:
        return back
    drop = max(select(opening >= 0.0, p2, p1) - back, 0.0)
    return back + _loss(opening, drop, par.return_back_pressure, par)
