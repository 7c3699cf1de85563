"""Kalman filters of the rig: the product filter, and two filters of the thesis for reference.

`registry` lists them by name. All are compiled; `FilterMemory` holds a filter's state.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
