"""The drivers on CAN: digital servovalves by CANopen (CiA 408), pump units by DBC."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
