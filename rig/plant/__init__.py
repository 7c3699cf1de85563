"""The physics of the rig, once: parameters with units, rates, integrator, sensors, effects.

Imports numpy and numba only; everything above shares this one model.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
