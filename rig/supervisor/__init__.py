"""Runs a hardware session: its processes, its state machine, and every way out of it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
