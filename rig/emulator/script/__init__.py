"""The faults of the emulated rig: scripts, their effects, and the port that controls them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
