"""The oil accounts of a test and the evidence of its verdict, collected as the detector decides.

A campaign collects them while its tests run, and a report of an older recording by a replay.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
