"""The emulated Modbus devices: the I/O node with its registers, and the bank of bypass valves."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
