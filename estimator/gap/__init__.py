"""The model-gap workflow finds where a model disagrees with recordings, and what the model lacks.

Its packages know a plant only by the class `plant.Plant`. `servo_actuator` makes the plant of this
project's rig.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
