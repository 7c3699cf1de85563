"""The compiled cycle of the rig: read, estimate, control, limit, write, record.

Nothing in it returns to Python before the run ends; knows no YAML.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
