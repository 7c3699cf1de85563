"""The leak detector: from oil accounts to a verdict with its size, its onset and its error rates.

`detection` takes samples and decides; `replaying` runs it over a recording; `baseline` learns what
is normal for a rig; `pattern` is the thesis's detector.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
