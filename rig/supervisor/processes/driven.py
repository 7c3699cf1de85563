"""What another master does to a rig that is in its safe state: counted, and reported now and then.

Whoever holds a part of the rig in its safe state brings it back there; a master that goes on would
otherwise fill log and report with the same line.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from rig.io import BALLS, DriveState, H

from .child import News

REPEAT_S: Final = 1.0
"""Time between two lines on the same part of the rig."""

_THROTTLE: Final = "return_blockage_needle"
_FREE: Final = 0.1
"""Part of its stroke by which a needle may be off: more than its driver takes for arrived."""


@dataclass(frozen=True)
class Driven(News):
    """A part of the rig that was found driven while it was held in its safe state.

    Attributes:
        part: which one.
        times: how often it was found so.
        first_ns: when first, CLOCK_MONOTONIC in ns.
        last_ns: when last.
    """

    part: str
    times: int
    first_ns: int
    last_ns: int

    @property
    def sentence(self) -> str:
        """What was found, and how often."""
        often = "once" if self.times == 1 else f"{self.times} times"
        return f"{self.part} driven by another master: {self.text}, {often}"


class Tally:
    """Counts by part; reports each part at once, and then at most every `REPEAT_S`.

    Args:
        who: which part of the software counts.
        report: is called with what is to be reported.
        clock: CLOCK_MONOTONIC in ns.
    """

    def __init__(
        self,
        who: str,
        report: Callable[[Driven], None],
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._who = who
        self._report = report
        self._clock = clock
        self._found: dict[str, Driven] = {}
        self._reported: dict[str, Driven] = {}

    def found(self, part: str, what: str) -> None:
        """Count a part that is driven now."""
        now, known = self._clock(), self._found.get(part)
        times, first_ns = (known.times + 1, known.first_ns) if known else (1, now)
        self.counted(part, what, times, first_ns, now)

    def counted(self, part: str, what: str, times: int, first_ns: int, last_ns: int) -> None:
        """Take over what was counted of a part so far."""
        now = self._clock()
        self._found[part] = Driven(now, self._who, what, part, times, first_ns, last_ns)
        reported = self._reported.get(part)
        if reported is None or (times != reported.times and now - reported.at_ns >= REPEAT_S * 1e9):
            self._say(part)

    def report_rest(self) -> None:
        """Report what was counted since the last report."""
        for part, found in self._found.items():
            if self._reported[part].times != found.times:
                self._say(part)

    def _say(self, part: str) -> None:
        self._reported[part] = replace(self._found[part], at_ns=self._clock())
        self._report(self._reported[part])


def departures(values: Mapping[str, float]) -> dict[str, str]:
    """Return what of slow inputs is not as in the safe state, by the part concerned.

    Args:
        values: as a driver read them, SI; NaN is no value and departs from nothing.
    """
    found = {}
    for name, value in values.items():
        part = name.removesuffix("_ball").replace("_", " ")
        if name in BALLS and value > 0.0:
            found[f"{part} bypass"] = "open" if value == 1.0 else "not shut"
        elif name == _THROTTLE and value > _FREE:
            found["return throttle"] = f"at {100.0 * value:.0f} % of its way"
        elif name == "pump_loaded" and value == 1.0:
            found["pump"] = "loaded"
        elif name == "drive_state" and value == value and int(value) & H:
            known = int(value) in set(DriveState)
            found["valve drive"] = DriveState(int(value)).name if known else f"state {value:g}"
    return found
