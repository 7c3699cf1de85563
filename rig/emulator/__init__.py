"""The emulated rig: a program that runs the plant in real time and serves the real protocols."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
