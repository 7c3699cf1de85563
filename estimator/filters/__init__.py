"""Kalman filters of the rig: the product's own, and the three of the thesis for reference.

`registry` tells them by name. All are compiled; a filter's state is a `FilterMemory`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
