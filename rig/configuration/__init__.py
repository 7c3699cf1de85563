"""Reads YAML with units into the objects of the layers below: rigs, models, campaigns.

Every mistake of a file is reported at once, with line, value, limit and remedy.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
