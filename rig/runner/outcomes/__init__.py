"""Defines the outcomes of tests with their figures and decisions, and how they are recorded."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
