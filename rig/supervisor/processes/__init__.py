"""The processes of a session besides the supervisor's, and how it watches over them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
