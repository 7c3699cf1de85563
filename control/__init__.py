"""Position control and setpoint generators of the rig.

Compiled where the loop needs it; setpoints are tables known before the run.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
