"""The protocol by which the software uses hardware (read, write, safe_state), and its drivers.

Addresses come from the configuration. A library that one driver needs is imported by no other.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
