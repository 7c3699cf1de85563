"""The plant as the gap workflow sees it: four compiled functions, names, units and bands."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
