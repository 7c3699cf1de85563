"""What every sample is judged by: limits, plausibility, and what a breach calls for."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
