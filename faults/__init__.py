"""Leaks as injected: bypass valves, fault schedules, campaigns of tests and their verdicts.

Coefficients are SI; every injected leak is recorded as ground truth.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
