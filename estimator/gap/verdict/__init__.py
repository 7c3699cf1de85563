"""This package gives the verdict on what a search found, and decides which model is written."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
