"""Setpoints of a test: the position that the ram follows, or the command that the valve receives.

A setpoint of quantity "position" is in metres and closes the position loop; one of quantity
"command" is in volts and drives the servovalve in open loop. Times are seconds from the start of
the test. Every setpoint is a pure function of time: it may be sampled in any windows and in any
order, always with the same values. The loop receives it as a table.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
