"""What healthy hours of one rig tell of its own noise: by regime, and how often a limit is crossed.

`regimes` says how the ram of a block works, `noise` holds what was learnt and weighs blocks by it,
`measuring` measures the noise of a regime, and `tail` extrapolates crossings to rarer ones.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
