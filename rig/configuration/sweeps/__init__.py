"""Sweep files give distributions of parameters, motions and leaks, and the filter that judges."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
