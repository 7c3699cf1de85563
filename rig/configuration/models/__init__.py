"""Model files: parameters, effects, terms in symbols, and plants that users describe in Python."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
