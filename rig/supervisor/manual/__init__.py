"""Manual mode: a person moves ram, pump and bypasses by commands, one at a time.

A motion is laid out at most 200 ms ahead of the loop, and always ends at rest there.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
