"""The names of everything that passes between the rig and the software, with its unit.

What is read follows from the table of channels (`rig.channels`). A driver maps its wire to these
names; the loop, the limits and the recordings know nothing else.
Values are float64 in SI; switches are 0 or 1; NaN is a value that is not there.
"""

from typing import Final

from rig.channels import BYPASSES, Kind, Source, names_from, names_of

FAST_INPUTS: Final = names_of(Kind.READING, Kind.STATUS, Kind.CARRIED)
"""What a fast driver may read in one exchange; the first nine are those of `Reading`.

`position_m` of an incremental encoder counts from where it was switched on, until homed.
`estop_closed` is 1 while the emergency stop's chain is closed. `device_counter` counts the device's
own samples, `device_echo` returns the last `host_counter` it took, and `device_command_V` is what
its valve output really stands at.
"""

FAST_OUTPUTS: Final = ("command_V", "valve_enable", "host_counter", "reset_lamp", "rearm")
"""What the loop writes in one exchange.

`valve_enable` 1 lets the valve's relay close; `host_counter` counts exchanges modulo 65536 and is
what the device's watchdog watches; `reset_lamp` asks the operator for the reset button; `rearm`
acknowledges a watchdog that has tripped by its rising edge.
"""

BALLS: Final = tuple(f"{bypass}_ball" for bypass in BYPASSES)
"""Position of each ball valve, 0 shut to 1 open; as output 0 or 1."""

NEEDLES: Final = tuple(f"{bypass}_needle" for bypass in BYPASSES)
"""Opening of each needle valve, 0 to 1, as output and as input."""

METERS: Final = names_from(Source.METERS)
"""The leak-flow meters, which a slow driver may supply instead of the fast one."""

SLOW_INPUTS: Final = (*METERS, *names_of(Kind.SLOW))
"""What slow drivers may read, in the order in which the field process publishes it.

`drive_state` is a digital servovalve's state (`rig.io.can.ds408.DriveState`), `drive_setpoint` runs
from -1 to 1; `pump_loaded` is 1 while the pump unit delivers pressure (0: unloaded).
"""

SLOW_OUTPUTS: Final = (*BALLS, *NEEDLES, "drive_target", "drive_setpoint", "pump_load")
"""What slow drivers may write: `drive_target` is the `DriveState` asked for."""
