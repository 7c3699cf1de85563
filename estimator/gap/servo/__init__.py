"""The servo-actuator of this project as a plant, with its effects and the terms it proposes."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
