"""The compiled cycle of the rig: read, estimate, control, limit, write, record.

Compiled code runs the ticks, without a return to Python between them. This package reads no YAML.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
