"""Faults that are injected, and campaigns, tests and verdicts as data.

Leakage laws, bypass valves, needle valves with their calibration, and fault schedules belong to it.
The coefficient of a fault, which is its size, is in SI units.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
