"""Accounts of the operator's console: who there is, by which password, and what each role may do.

It knows neither the console nor the rig, so that `rig accounts` starts quickly.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
