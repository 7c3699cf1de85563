"""Runs sweeps: thousands of cases drawn at random, in lanes on all cores or on a Dask cluster.

A case follows from the sweep's file and the case's number alone, whichever process runs it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
