"""This package describes a plant to the gap workflow, and prepares recordings for its filter."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
