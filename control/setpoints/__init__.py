"""Setpoints of a test: what the ram is asked to follow, or the valve to receive.

A setpoint of quantity "position" is in metres and closes the position loop; one of quantity
"command" is in volts and drives the servovalve in open loop. Times are seconds from the start of
the test. Every setpoint is a pure function of time, so that any window of it, sampled in any
order, is the same signal; the loop receives it as a table.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
