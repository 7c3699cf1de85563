"""The driver of the bypass valves, by Modbus TCP or RTU."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
