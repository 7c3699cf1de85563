"""The model-gap workflow: where a model and its recordings disagree, what is missing, what it adds.

A plant is seen through `plant.Plant` only; `servo_actuator` is the rig's own.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
