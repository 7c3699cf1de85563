"""Rig files, with drivers, limits, valves, calibrations, register maps, the stream's profile."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
