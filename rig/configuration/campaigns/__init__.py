"""Campaign files: tests, setpoints, faults, conditions, schedules, and the dry run."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
