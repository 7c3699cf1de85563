"""This package reads and writes recordings (MCAP, CSV, Parquet), lossless for all filter inputs.

Channels carry their unit in the name; missing samples are NaN.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
