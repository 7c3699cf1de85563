"""Commissions a new rig: finds signs, null, noise, stroke, friction, and a baseline."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
