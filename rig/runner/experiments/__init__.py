"""Runs experiments that consist of several campaigns: friction, and closing a gap on a rig."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
