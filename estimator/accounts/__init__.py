"""Oil accounts: what flows into a chamber, less what moves and compresses, block by block.

A leak is what an account lacks. The sums are kept as a regression, so that what else could explain
them is fitted along.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
