"""Turns decisions into rows for the loop, and finds in the loop's rows what it did about faults."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.accounts import reference_flow
from estimator.leaks import CONFIRMED_AFTER_S, Decision
from faults import Verdict, to_litres_per_minute
from rig.loop import ACTED, PRESENT, PROBABLE, VERDICT_CODES, Reaction
from rig.plant import LEAKS, Parameters

from .figures import Array

EVENT: Final = "on_fault"
_HOLDING: Final = "holding the ram"
_NO_FAULT: Final = (Verdict.HEALTHY, Verdict.INCONCLUSIVE)


class DecisionRows:
    """Turns the decisions of one test into rows that the loop reads.

    The decisions must be given in the order of their times, since the object remembers from when on
    the verdict has been the same.
    """

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


@dataclass(frozen=True)
class FaultAction:
    """One action of the loop about a fault.

    Attributes:
        at_s: when it began, s of the test.
        until_s: when it ended, s of the test; None if it lasted to the end.
        what: the action in words, as in an event of the recording: "holding the ram" or "tolerating
            external_leakage_1 0.42 L/min".
    """

    at_s: float
    until_s: float | None
    what: str

    @property
    def holds(self) -> bool:
        """Whether the loop held the ram; if not, it tolerated a leak, and compensated for it."""
        return self.what == _HOLDING


class Reactions:
    """Follows the rows of one test, and collects the loop's actions about faults.

    Args:
        channels: names of the rows' columns.
        assumed: the parameters with which a leak's coefficient is converted to a flow.

    Attributes:
        actions: the loop's actions so far, in their order.
    """

    def __init__(self, channels: tuple[str, ...], assumed: Parameters) -> None:
        self._action = channels.index(ACTED[0])
        self._present = [channels.index(name) for name in PRESENT]
        self._assumed = assumed
        self._doing = 0
        self.actions: list[FaultAction] = []

    def take(self, rows: Array) -> Iterator[tuple[float, str, str]]:
        """Process the next rows, update `actions`, and yield each change of action as an event.

        An event is (time in s, kind of event, text). The rows are only processed as the events are
        taken from the iterator.
        """
        action = rows[:, self._action]
        if not self._doing and not action.any():
            return
        present = rows[:, self._present] > 0.0
        tolerates = action == Reaction.TOLERATE
        # One number encodes the action and which leaks are tolerated.
        doing = (8 * np.nan_to_num(action) + tolerates * (present @ (1, 2, 4))).astype(np.int64)
        for k in np.flatnonzero(np.diff(doing, prepend=self._doing)):
            yield float(rows[k, 0]), EVENT, self._change(rows[k])
        if len(doing):
            self._doing = int(doing[-1])

    def _change(self, row: Array) -> str:
        time_s, action = float(row[0]), int(row[self._action])
        if self.actions and self.actions[-1].until_s is None:
            self.actions[-1] = replace(self.actions[-1], until_s=time_s)
        if action == Reaction.IGNORE:
            return "back to proportional"
        what = _HOLDING if action == Reaction.HOLD else self._tolerating(row)
        self.actions.append(FaultAction(time_s, None, what))
        return what

    def _tolerating(self, row: Array) -> str:
        leaks = []
        for leak, column in zip(LEAKS, self._present, strict=True):
            coefficient = float(row[column])
            if coefficient > 0.0:
                flow = reference_flow(self._assumed, leak, coefficient)
                leaks.append(f"{leak} {to_litres_per_minute(flow):.2f} L/min")
        return f"tolerating {', '.join(leaks)}"
