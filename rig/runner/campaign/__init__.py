"""Running a campaign: its tests one after the other, the operator's requests, the way out."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
