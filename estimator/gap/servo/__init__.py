"""This package describes the servo-actuator of this project as a plant for the gap workflow."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
