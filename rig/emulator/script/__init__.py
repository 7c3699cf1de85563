"""What goes wrong on the emulated rig, and when: scripts, faults, and the port that steers it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
