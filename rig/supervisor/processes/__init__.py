"""The processes of a session beside the supervisor, and the safety thread that watches them."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
