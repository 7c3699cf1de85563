"""The loop on hardware: its compiled ticks, its shared memory, and the orders that it obeys."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
