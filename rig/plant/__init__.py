"""The physics of the rig in one place: parameters with units, rates, integrator, sensors, effects.

Simulation, filters, controller and gap workflow all share this one model. Of the project's packages
this one imports only those for compiled code, `rig.jit` and `rig.lanes`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
