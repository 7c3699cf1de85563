"""Sweeps: thousands of cases drawn at random, run in lanes on all cores or on a Dask cluster.

A case is a function of the sweep's file and the case's number, whoever runs it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
