"""The driver of the I/O node, which exchanges command and readings by Modbus TCP once a tick."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
