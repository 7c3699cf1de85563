"""What the pressures of a locked cylinder tell of its leaks: accounts of soaks, and their fit.

`soaks` holds the samples of one soak and draws up its account; `columns` has what each leak and
each known disturbance does to an account; `fit` fits all of them together and gives the verdicts.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
