"""The rig's hardware as a program of its own: the plant in real time behind the real protocols."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
