"""A station owns a rig from power-on to power-off: it reads, journals, and lends the rig."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
