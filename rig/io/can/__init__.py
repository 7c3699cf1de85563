"""The drivers of devices on CAN: digital servovalves (CANopen, CiA 408) and pump units (DBC)."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
