"""Setpoints of a test: what the ram is asked to follow, or the valve to receive.

A setpoint of quantity "position" is in metres and closes the position loop; one of quantity
"command" is in volts and drives the servovalve in open loop. Times are seconds from the start of
the test. Every setpoint is a pure function of time, so that any window of it, sampled in any
order, is the same signal; the loop receives it as a table.
"""

from .csv_table import SetpointFileError
from .held import Constant, Pseudorandom, Steps
from .periodic import Chirp, Multisine, Sine
from .polyline import Polyline
from .protocol import Quantity, Samples, Setpoint, SetpointError, Times
from .tabulated import FromFile

__all__ = [
    "Chirp",
    "Constant",
    "FromFile",
    "Multisine",
    "Polyline",
    "Pseudorandom",
    "Quantity",
    "Samples",
    "Setpoint",
    "SetpointError",
    "SetpointFileError",
    "Sine",
    "Steps",
    "Times",
]
