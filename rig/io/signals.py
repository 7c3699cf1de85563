"""The names of all signals that pass between the rig and the software, with their units.

The names of inputs come from the table of channels (`rig.channels`). A driver translates between
its device and these names; the loop, the limits and the recordings use these names alone. Values
are float64 in SI. A switch is 0 or 1. NaN stands for a missing value.
"""

from typing import Final

from rig.channels import BLOCKING, BYPASSES, Kind, Source, names_from, names_of

FAST_INPUTS: Final = names_of(Kind.READING, Kind.STATUS, Kind.CARRIED)
"""Signals that a fast driver may read in one exchange; the first nine are those of `Reading`.

`position_m` of an incremental encoder counts from where it was switched on, until the rig is homed.
`estop_closed` is 1 while the emergency stop's chain is closed. `device_counter` counts the device's
own samples, `device_echo` is the last `host_counter` that the device received, and
`device_command_V` is the voltage that its valve output really has.
"""

FAST_OUTPUTS: Final = ("command_V", "valve_enable", "host_counter", "reset_lamp", "rearm")
"""Signals that the loop writes in one exchange.

With `valve_enable` = 1 the valve's relay may close. `host_counter` counts exchanges modulo 65536;
the device's watchdog trips when it stops counting. `reset_lamp` = 1 asks the operator to press the
reset button. The rising edge of `rearm` acknowledges a watchdog that has tripped.
"""

BALLS: Final = tuple(f"{bypass}_ball" for bypass in BYPASSES)
"""Position of each ball valve, from 0 (shut) to 1 (open); as an output it is 0 or 1."""

NEEDLES: Final = tuple(f"{bypass}_needle" for bypass in BYPASSES)
"""Opening of each needle valve, from 0 to 1, as an output and as an input."""

METERS: Final = names_from(Source.METERS)
"""Signals of the leak-flow meters, which a slow driver may supply instead of the fast one."""

SLOW_INPUTS: Final = (*METERS, *names_of(Kind.SLOW))
"""Signals that slow drivers may read, in the order in which the field process publishes them.

`drive_state` is a digital servovalve's state (`rig.io.can.ds408.DriveState`), `drive_setpoint` runs
from -1 to 1; `pump_loaded` is 1 while the pump unit delivers pressure (0: unloaded).
"""

SLOW_OUTPUTS: Final = (*BALLS, *NEEDLES, "drive_target", "drive_setpoint", "pump_load", *BLOCKING)
"""Signals that slow drivers may write; `drive_target` is the `DriveState` that is asked for.

A blocking valve is ordered to shut by 1 and to open by 0.
"""
