"""Experiments that are more than a campaign: friction, and closing a gap on a live rig."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
