"""Counts what a rig has done, for its maintenance: cycles, metres and hours, kept in a file."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
