"""The supervisor runs a hardware session: its processes, its states, and its end in any case."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
