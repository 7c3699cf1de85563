"""The interlock, which judges every sample: limits, plausibility, and the actions they cause."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
