"""Handles folders of runs: journal, results, resuming, comparing, trends, archive, pruning."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
