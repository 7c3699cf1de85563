"""Lanes: one number of each of several independent rigs, computed with together.

A compiled function written for floats takes lanes as well, if it chooses by `select` where rigs may
differ, and branches only on what is true `anywhere` or `everywhere`. The processor then carries out
each operation for all rigs at once (SIMD). Every operation but e^x rounds as the one on floats.
"""

from . import arithmetic, exponential
from .alignment import align_stack, aligned, empty_lanes
from .arrays import in_lanes
from .choosing import anywhere, everywhere, select
from .kinds import LANES, lanes, truths
from .memory import gather, load, load_fields, scatter, store

__all__ = [
    "LANES",
    "align_stack",
    "aligned",
    "anywhere",
    "arithmetic",
    "empty_lanes",
    "everywhere",
    "exponential",
    "gather",
    "in_lanes",
    "lanes",
    "load",
    "load_fields",
    "scatter",
    "select",
    "store",
    "truths",
]
