"""Injected faults: bypass valves, fault schedules, campaigns of tests and their verdicts.

Coefficients are in SI units. Every injected leak is recorded as ground truth.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
