"""The position loop, its compensation of leaks, and the setpoints of tests.

The functions that the loop calls are compiled. Setpoints are sampled into tables before a test
begins.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
