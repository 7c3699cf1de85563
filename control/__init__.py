"""Position control and setpoint generators of the rig.

What the loop calls is compiled. Setpoints become tables before the run begins.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
