"""Makes the page of a campaign, the page that compares two runs, and the page of trends."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
