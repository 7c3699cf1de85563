"""The detector's newest decision as columns of numbers, which the loop copies into every row.

So a recording shows for each sample what was decided when it came, and what the loop could act
upon. All columns are NaN before the first decision.
"""

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from faults import FAULT_KINDS, LEAK_KINDS, Verdict

Array = NDArray[np.float64]

VERDICT_CODES: Final = (
    Verdict.HEALTHY,
    Verdict.EXTERNAL_LEAKAGE_1,
    Verdict.EXTERNAL_LEAKAGE_2,
    Verdict.INTERNAL_LEAKAGE,
    Verdict.SUPPLY_LEAKAGE,
    Verdict.RETURN_BLOCKAGE,
    Verdict.MULTIPLE,
    Verdict.UNKNOWN_FAULT,
    Verdict.INCONCLUSIVE,
    Verdict.ENCODER_DRIFT,
)
"""Verdicts in the order of their codes, which never change, because recordings contain them."""

PROBABLE: Final = (Verdict.HEALTHY, *FAULT_KINDS, Verdict.MULTIPLE)
"""Verdicts that have a probability; the probabilities add up to 1."""
PROBABILITIES: Final = tuple(f"probability_{name}" for name in PROBABLE)
PRESENT: Final = tuple(f"present_{leak}_m3_per_s_sqrtPa" for leak in LEAK_KINDS)

DECIDED: Final = (
    "decided_at_s",
    "verdict_code",
    "fault_confirmed",
    *PROBABILITIES,
    "decided_leak_m3_per_s",
    "decided_leak_low_m3_per_s",
    "decided_leak_high_m3_per_s",
    *PRESENT,
)
"""Columns of a decision: time of the newest sample on which it rests; index in `VERDICT_CODES`; 1
for a confirmed fault, else 0; probabilities; mean leak flow with its 95 % interval, NaN without a
leak; coefficients of the leaks that are confirmed to be there now, 0 where there is none."""


class Decided(IntEnum):
    """Index in a row of `DECIDED` of the numbers on which the loop acts."""

    AT_S = DECIDED.index("decided_at_s")
    """Time in the test, s, of the newest sample on which the decision rests."""
    VERDICT = DECIDED.index("verdict_code")
    """Index in `VERDICT_CODES`."""
    CONFIRMED = DECIDED.index("fault_confirmed")
    """1 for a confirmed fault, else 0."""
    PRESENT = DECIDED.index(PRESENT[0])
    """First of the three coefficients of leaks that are there now, in the order of `PRESENT`."""


def no_decision() -> Array:
    """Return the row before the first decision, float64 (len(DECIDED),)."""
    return np.full(len(DECIDED), np.nan)


def confirmed_fault(row: Array) -> str:
    """Return the fault that a decision, a row of `DECIDED`, confirms; empty if it confirms none.

    The text is such as "external_leakage_1 confirmed".
    """
    if row[Decided.CONFIRMED] != 1.0:
        return ""
    return f"{VERDICT_CODES[int(row[Decided.VERDICT])]} confirmed"
