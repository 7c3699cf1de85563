"""What a search amounts to: findings, none, or something unknown; and the model that is written."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
