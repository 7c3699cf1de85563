"""Mutants that no test notices because they change nothing that matters, each with the reason."""

from typing import Final

_STRICT: Final = "`strict` only guards against a field that somebody adds on one side."
_SHAPE: Final = "The compiler refuses it; without, nobody reads the rest of an action that is none."
_INFINITE: Final = "Only an infinite time gets there, which is above both or below both."
_ZERO_FLOW: Final = "Where the flow is 0, both branches give 0."

HARMLESS: Final = {
    "_COUNTERS: `65536` -> `65537`": "Where the counter turns, four ticks count against the "
    "device, of twenty that trip.",
    "InterlockMemory.clear: `True` -> `False`": _STRICT,
    "allowed_command: `load_pressure * above > 0.0` -> `load_pressure * above >= 0.0`": "Where the "
    "product is 0, both branches give the same command.",
    "allowed_command: `pushed <= _GENTLE` -> `pushed < _GENTLE`": "At three quarters of the limit, "
    "both branches give the null.",
    "with_limits: `True` -> `False`": _STRICT,
    "judged_sample: `0` -> `1`": "In `worst[0] < _TRIP`: without a cause both numbers are 0, and "
    "each cause of the chain has a number above that of a trip.",
    "judged_sample: `_TRIP` -> `_INDICATE`": "In `worst[0] < _TRIP`: the chain returns a trip or "
    "no action, and nothing between them.",
    "_chain: without `_NONE`": _SHAPE,
    "_chain: without `_NONE` (2)": _SHAPE,
    "_chain: without `NO_CHANNEL`": _SHAPE,
    "_transducers: `0` -> `1`": "The number of equal samples that are bad is 0 or, at any period "
    "of a loop, far above 1.",
    "_unhomed: without `_NONE`": _SHAPE,
    "_unhomed: without `_NONE` (2)": _SHAPE,
    "_unhomed: without `NO_CHANNEL`": _SHAPE,
    "_unhomed: without `_NONE` (3)": _SHAPE,
    "_unhomed: without `_NONE` (4)": _SHAPE,
    "_unhomed: without `NO_CHANNEL` (3)": _SHAPE,
    "_unhomed: `force > 0.0` -> `force >= 0.0`": "Where the force is 0, the ticks of too great a "
    "force have just been set to 0.",
    "_unhomed: `0.0` -> `1.0`": "1 V Pa is nothing beside the 8 MPa that must be exceeded.",
    "_unhomed: `0.0` -> `1.0` (2)": "1 Pa is nothing beside the 8 MPa that must be exceeded.",
    "_SETTLED_TICKS: `200` -> `201`": "After 200 ticks the nominal spool is at its command to the "
    "last bits, and one tick more changes none of them.",
    "_in_a_gap: `0.5 * tol.jump_speed_m_per_s * longer_s > tol.flow_account_m` -> "
    "`0.5 * tol.jump_speed_m_per_s * longer_s >= tol.flow_account_m`": "They differ where the ram "
    "can go 5 mm to the last bit, which is between 5 and 6 ms.",
    "_against_flow: `values[_SUPPLY] > supply` -> `values[_SUPPLY] >= supply`": "Where both are "
    "equal, either gives the same supply pressure.",
    "_against_flow: `q1 > 0.0` -> `q1 >= 0.0`": _ZERO_FLOW,
    "_against_flow: `q2 < 0.0` -> `q2 <= 0.0`": _ZERO_FLOW,
    "_place: `time_s > 0.0` -> `time_s >= 0.0`": _INFINITE,
    "_place: `0.0` -> `1.0`": _INFINITE,
}
"""Reason, by the mutant's name."""
