"""This package predicts recordings by a model: filter, sensitivities, fit and held-out gap.

The filter's gains are computed once and then kept, so that predictions depend on parameters alone.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
