"""Predicting recordings by a model: filter with frozen gains, sensitivities, fit, held-out gap."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
