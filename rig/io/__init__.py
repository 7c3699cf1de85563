"""One protocol to the hardware (read, write, safe_state) and the drivers that serve it.

Addresses come from configuration; optional imports stay inside the driver that needs them.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
