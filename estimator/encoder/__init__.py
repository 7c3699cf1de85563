"""Drift of the encoder: told from a leak past the piston and from a null that shifts.

`drift_test` looks for it in the blocks of the oil account at a stated rate of false alarms, and
`records` holds what it finds, with the other causes that could still explain it.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
