"""Lanes: vectors that hold one number of each of several independent rigs, for parallel computing.

A compiled function that was written for floats takes lanes as well, under two conditions: it uses
`select` instead of a branch where rigs may differ, and it branches only on a condition that is true
`anywhere` or `everywhere`. The processor then carries out each operation for all rigs at once
(SIMD). Every operation except e^x, sine and cosine rounds exactly as on floats.
"""

from lazy_loader import attach_stub

# These teach the compiler what operators and functions do with lanes.
from . import (
    arithmetic as arithmetic,
    error_function as error_function,
    exponential as exponential,
    sines as sines,
)

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
