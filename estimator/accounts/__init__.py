"""Oil accounts: the oil that entered a chamber, less what moved the ram or was compressed.

Oil that is missing in an account has leaked, or the model is wrong. A regression over the accounts
fits the known weaknesses of the model along with a fault.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
