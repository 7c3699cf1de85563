"""This package reads YAML files with units into rigs, models, campaigns and other objects.

All mistakes of a file are reported together, each with its line, the value, the rule that it breaks
and a remedy.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
