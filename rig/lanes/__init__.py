"""Lanes: vectors that hold one number of each of several independent rigs, for parallel computing.

A compiled function that was written for floats takes lanes as well, under two conditions: it uses
`select` instead of a branch where rigs may differ, and it branches only on a condition that is true
`anywhere` or `everywhere`. The processor then carries out each operation for all rigs at once
(SIMD). Every operation except e^x rounds exactly as on floats.
"""

from . import arithmetic, exponential
from .alignment import align_stack, aligned, empty_lanes
from .arithmetic import emit_function
from .arrays import in_lanes
from .choosing import anywhere, everywhere, select
from .kinds import LANES, intrinsic, lanes, truths
from .memory import gather, load, load_fields, scatter, store
from .normal import fill_normal, sine_and_cosine, start_streams

__all__ = [
    "LANES",
    "align_stack",
    "aligned",
    "anywhere",
    "arithmetic",
    "emit_function",
    "empty_lanes",
    "everywhere",
    "exponential",
    "fill_normal",
    "gather",
    "in_lanes",
    "intrinsic",
    "lanes",
    "load",
    "load_fields",
    "scatter",
    "select",
    "sine_and_cosine",
    "start_streams",
    "store",
    "truths",
]
