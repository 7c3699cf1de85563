"""The leak detector, which turns oil accounts into a verdict with size, onset and error rates.

`detection` takes samples and decides; `replaying` runs a detector over a recording;
`pattern` is the thesis's detector.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
