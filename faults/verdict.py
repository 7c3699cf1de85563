"""The verdicts that a test may have, and the faults among them that can be injected."""

from enum import StrEnum
from typing import Final

from rig.plant import FAULTS, LEAKS


class Verdict(StrEnum):
    """A conclusion of the leak detector; each compares equal to its name as a string."""

    description: str

    def __new__(cls, value: str, description: str = "") -> "Verdict":
        """Return a verdict with a name and a description of one line."""
        verdict = str.__new__(cls, value)
        verdict._value_ = value
        verdict.description = description
        return verdict

    HEALTHY = "healthy", "no fault found by a motion that would have shown one"
    EXTERNAL_LEAKAGE_1 = "external_leakage_1", "chamber 1 leaks to the return line"
    EXTERNAL_LEAKAGE_2 = "external_leakage_2", "chamber 2 leaks to the return line"
    INTERNAL_LEAKAGE = "internal_leakage", "oil passes the piston seal between the chambers"
    SUPPLY_LEAKAGE = "supply_leakage", "the supply line leaks to the return line"
    RETURN_BLOCKAGE = "return_blockage", "the return line is blocked, as by a clogged filter"
    MULTIPLE = "multiple", "more than one fault at once"
    UNKNOWN_FAULT = "unknown_fault", "the rig departs from its model as no known fault makes it"
    ENCODER_DRIFT = "encoder_drift", "the encoder's reading runs away from the ram"
    INCONCLUSIVE = "inconclusive", "the motion could not have shown a leak"


LEAK_KINDS: Final = tuple(map(Verdict, LEAKS))
"""Leaks of the actuator itself, whose flow the default detector estimates."""

FAULT_KINDS: Final = tuple(map(Verdict, FAULTS))
"""Faults that the rig can inject (figure 2.3)."""
