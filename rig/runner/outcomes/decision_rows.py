"""Turns a test's decisions into the rows of numbers that the loop takes."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import CONFIRMED_AFTER_S, Decision
from faults import Verdict
from rig.loop import PROBABLE, VERDICT_CODES

Array = NDArray[np.float64]

_NO_FAULT: Final = (Verdict.HEALTHY, Verdict.INCONCLUSIVE)


class DecisionRows:
    """Turns the decisions of one test into rows; they must be given in the order of their times."""

    def __init__(self) -> None:
        self._verdict = ""
        self._held_since_s = 0.0

    def row(self, time_s: float, decision: Decision) -> Array:
        """Return a decision as a row, float64 (len(`rig.loop.decided.DECIDED`),), SI.

        The row says that a fault is confirmed if the decision lists a leak as present now, or if
        the verdict has been the same fault for 5 s. Probabilities, flow and interval that the
        decision lacks are NaN.

        Args:
            time_s: time of the newest sample that the decision rests on, s.
            decision: the decision.

        Raises:
            ValueError: the verdict is none of `VERDICT_CODES`.
        """
        if decision.verdict not in VERDICT_CODES:
            known = f"a detector may decide on {', '.join(VERDICT_CODES)}"
            raise ValueError(f"verdict {decision.verdict!r} is not known; {known}")
        if decision.verdict != self._verdict:
            self._verdict, self._held_since_s = decision.verdict, time_s
        is_fault = decision.verdict not in _NO_FAULT
        held = is_fault and time_s - self._held_since_s >= CONFIRMED_AFTER_S
        flow = decision.leak_m3_per_s
        return np.array(
            [
                time_s,
                VERDICT_CODES.index(Verdict(decision.verdict)),
                float(held or any(decision.present_leaks)),
                *(decision.probabilities.get(name, np.nan) for name in PROBABLE),
                np.nan if flow is None else flow,
                *(decision.interval_m3_per_s or (np.nan, np.nan)),
                *decision.present_leaks,
            ],
            np.float64,
        )
