"""Searching for what a model lacks: candidates are screened, refitted, and held against rivals."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
