"""Finds in the loop's rows what the loop did about confirmed faults."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import reference_flow
from faults import to_litres_per_minute
from rig.loop import ACTED, PRESENT, Reaction
from rig.plant import LEAKS, Parameters

Array = NDArray[np.float64]

EVENT: Final = "on_fault"
_HOLDING: Final = "holding the ram"


@dataclass(frozen=True)
class FaultAction:
    """One action of the loop about a fault.

    Attributes:
        at_s: when it began, s of the test.
        until_s: when it ended, s of the test; None if it lasted to the end.
        what: in words, as an event of the recording: "tolerating external_leakage_1 0.42 L/min".
    """

    at_s: float
    until_s: float | None
    what: str

    @property
    def holds(self) -> bool:
        """Whether the loop held the ram; if not, it compensated for a leak."""
        return self.what == _HOLDING


class Reactions:
    """Follows the rows of one test, and collects the loop's actions about faults.

    Args:
        channels: names of the rows' columns.
        assumed: the parameters with which a leak's coefficient is converted to a flow.
    """

    def __init__(self, channels: tuple[str, ...], assumed: Parameters) -> None:
        self._action = channels.index(ACTED[0])
        self._present = [channels.index(name) for name in PRESENT]
        self._assumed = assumed
        self._doing = 0
        self._actions: list[FaultAction] = []

    @property
    def actions(self) -> tuple[FaultAction, ...]:
        """The loop's actions so far, in their order."""
        return tuple(self._actions)

    def take(self, rows: Array) -> Iterator[tuple[float, str, str]]:
        """Process the next rows, and yield each change of action in them as an event.

        An event is (time in s, kind of event, text). The rows are only processed as the events are
        taken from the iterator.
        """
        action, present = rows[:, self._action], rows[:, self._present] > 0.0
        tolerates = action == Reaction.TOLERATE
        # One number encodes the action and which leaks are tolerated.
        doing = (8 * np.nan_to_num(action) + tolerates * (present @ (1, 2, 4))).astype(np.int64)
        for k in np.flatnonzero(np.diff(doing, prepend=self._doing)):
            yield float(rows[k, 0]), EVENT, self._change(rows[k])
        if len(doing):
            self._doing = int(doing[-1])

    def _change(self, row: Array) -> str:
        time_s, action = float(row[0]), int(row[self._action])
        if self._actions and self._actions[-1].until_s is None:
            self._actions[-1] = replace(self._actions[-1], until_s=time_s)
        if action == Reaction.IGNORE:
            return "back to proportional"
        what = _HOLDING if action == Reaction.HOLD else self._tolerating(row)
        self._actions.append(FaultAction(time_s, None, what))
        return what

    def _tolerating(self, row: Array) -> str:
        leaks = []
        for leak, column in zip(LEAKS, self._present, strict=True):
            coefficient = float(row[column])
            if coefficient > 0.0:
                flow = reference_flow(self._assumed, leak, coefficient)
                leaks.append(f"{leak} {to_litres_per_minute(flow):.2f} L/min")
        return f"tolerating {', '.join(leaks)}"
