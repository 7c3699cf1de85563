"""Leaks that come and go: evidence that is kept while a leak is shut, and what its openings tell.

`return_test` decides at a stated rate of false alarms whether a leak returns; `openings` tells when
it was open, for what share of the time, and `company` what it goes with.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
