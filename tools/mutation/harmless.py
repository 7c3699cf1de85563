"""Mutants that no test notices because they change nothing that matters, each with the reason."""

from typing import Final

_STRICT: Final = "`strict` only guards against a field that somebody adds on one side."
_SHAPE: Final = "The compiler refuses it; without, nobody reads the rest of an action that is none."
_EXACT: Final = "It differs only where a number with noise equals its threshold to the last bit."

HARMLESS: Final = {
    "_COUNTERS: `65536` -> `65537`": "Where the counter turns, four ticks count against the "
    "device, of twenty that trip.",
    "InterlockMemory.clear: `True` -> `False`": _STRICT,
    "allowed_command: `load_pressure * above > 0.0` -> `load_pressure * above >= 0.0`": "Where the "
    "product is 0, both branches give the same command.",
    "_device: `output < lowest - tol.command_V` -> `output <= lowest - tol.command_V`": _EXACT,
    "_above_supply: `p2 > limit` -> `p2 >= limit`": _EXACT,
    "_unhomed: without `_NONE`": _SHAPE,
    "_unhomed: `0.0` -> `1.0`": "1 V Pa is nothing beside the 8 MPa that must be exceeded.",
}
"""Reason, by the mutant's name."""
