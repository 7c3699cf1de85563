"""Friction of a rig, identified from strokes, from break-aways and from their joint fit."""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
