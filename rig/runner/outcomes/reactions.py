"""What the loop did about faults, read from the rows it wrote."""

from collections.abc import Iterator
from dataclasses import dataclass
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
    """What the loop did about a fault, and when.

    Attributes:
        until_s: None if it did so to the end.
        what: in words, as an event of the recording: "tolerating external_leakage_1 0.42 L/min".
    """

    at_s: float
    until_s: float | None
    what: str

    @property
    def holds(self) -> bool:
        """Whether it held the ram, rather than make up for a leak."""
        return self.what == _HOLDING


class Reactions:
    """The actions of one test, as its rows come.

    Args:
        channels: names of the rows' columns.
        assumed: the parameters that leak flows are quoted with.
    """

    def __init__(self, channels: tuple[str, ...], assumed: Parameters) -> None:
        self._action = channels.index(ACTED[0])
        self._present = [channels.index(name) for name in PRESENT]
        self._assumed = assumed
        self._doing = 0
        self._actions: list[FaultAction] = []

    @property
    def actions(self) -> tuple[FaultAction, ...]:
        """What was done so far."""
        return tuple(self._actions)

    def take(self, rows: Array) -> Iterator[tuple[float, str, str]]:
        """Take the next rows; yield what changed in them as (time in s, kind of event, text)."""
        action, present = rows[:, self._action], rows[:, self._present] > 0.0
        tolerates = action == Reaction.TOLERATE
        # The action, and which leaks are tolerated, as one number.
        doing = (8 * np.nan_to_num(action) + tolerates * (present @ (1, 2, 4))).astype(np.int64)
        for k in np.flatnonzero(np.diff(doing, prepend=self._doing)):
            yield float(rows[k, 0]), EVENT, self._change(rows[k])
        if len(doing):
            self._doing = int(doing[-1])

    def _change(self, row: Array) -> str:
        time_s, action = float(row[0]), int(row[self._action])
        if self._actions and self._actions[-1].until_s is None:
            last = self._actions[-1]
            self._actions[-1] = FaultAction(last.at_s, time_s, last.what)
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
