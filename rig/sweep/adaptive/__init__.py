"""Draws the sizes of leaks near the one of which a wanted share is found, and tells that size.

Nothing but monotony is assumed of how the share that is found depends on the size.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
