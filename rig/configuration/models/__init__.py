"""Model files: parameters, effects, terms in symbols, and plants from outside."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
