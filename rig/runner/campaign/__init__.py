"""Runs the tests of a campaign one after the other, serves operators' requests, and ends it."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
