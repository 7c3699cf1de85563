"""A station lends its rig: how it is found, asked for the rig, and told that it is free again.

A lease ends with its connection, so that it also ends if its holder is killed.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
