"""This package searches for what a model lacks: it screens effects, fits them and tries rivals."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
