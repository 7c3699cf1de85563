"""Moves that another master makes on a rig in its safe state are counted and reported here.

The process that keeps a part of the rig in its safe state brings it back there each time. Reports
are limited in rate, so that a master that goes on does not fill the log with the same line.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Final

from rig.channels import BLOCKING
from rig.io import BALLS, DriveState, H

from .child import News

REPEAT_S: Final = 1.0
"""Shortest time in s between two reports on the same part of the rig."""

_THROTTLE: Final = "return_blockage_needle"
_FREE: Final = 0.1
"""Fraction of its stroke above which the throttle counts as moved; its driver tolerates less."""


@dataclass(frozen=True)
class Driven(News):
    """A report on a part of the rig that another master drove out of its safe state.

    Attributes:
        text: the state in which it was found, such as "open".
        part: the part of the rig, such as "valve" or "pump".
        times: how often it was found driven.
        first_ns: when it was first found driven, CLOCK_MONOTONIC in ns.
        last_ns: when it was last found driven, CLOCK_MONOTONIC in ns.
    """

    part: str
    times: int
    first_ns: int
    last_ns: int

    @property
    def sentence(self) -> str:
        """A sentence on what was found, and how often."""
        often = "once" if self.times == 1 else f"{self.times} times"
        return f"{self.part} driven by another master: {self.text}, {often}"


class Tally:
    """A counter of moves by another master, which reports them with a limited rate.

    The first move of a part is reported at once, later ones at most every `REPEAT_S`.

    Args:
        who: the part of the software that counts.
        report: is called with each report.
    """

    def __init__(self, who: str, report: Callable[[Driven], None]) -> None:
        self._who = who
        self._report = report
        self._found: dict[str, Driven] = {}
        self._reported: dict[str, Driven] = {}

    def found(self, part: str, what: str) -> None:
        """Count that a part was found driven now, and report it when due.

        `what` is the state in which it was found, such as "open".
        """
        now, known = time.monotonic_ns(), self._found.get(part)
        times, first_ns = (known.times + 1, known.first_ns) if known else (1, now)
        self.counted(part, what, times, first_ns, now)

    def counted(self, part: str, what: str, times: int, first_ns: int, last_ns: int) -> None:
        """Set the count of a part to what the caller has counted so far, and report it when due.

        Args:
            part: the part of the rig.
            what: the state in which it was found.
            times: how often it was found driven.
            first_ns: when first, CLOCK_MONOTONIC in ns.
            last_ns: when last, CLOCK_MONOTONIC in ns.
        """
        now = time.monotonic_ns()
        self._found[part] = Driven(now, self._who, what, part, times, first_ns, last_ns)
        reported = self._reported.get(part)
        if reported is None or (times != reported.times and now - reported.at_ns >= REPEAT_S * 1e9):
            self._say(part)

    def report_rest(self) -> None:
        """Report each part whose count has grown since its last report."""
        for part, found in self._found.items():
            if self._reported[part].times != found.times:
                self._say(part)

    def _say(self, part: str) -> None:
        self._reported[part] = replace(self._found[part], at_ns=time.monotonic_ns())
        self._report(self._reported[part])


def departures(values: Mapping[str, float]) -> dict[str, str]:
    """Return part -> its state in words, for each part of the rig that is out of its safe state.

    That is a bypass whose ball valve is not shut, a blocking valve that is not open, a return
    throttle moved by more than a tenth of its stroke, a pump that is loaded, or a valve drive that
    is in hold or active.

    Args:
        values: slow input -> value that a driver read, SI; NaN counts as safe.
    """
    found = {}
    for name, value in values.items():
        part = name.removesuffix("_ball").replace("_", " ")
        if name in BALLS and value > 0.0:
            found[f"{part} bypass"] = "open" if value == 1.0 else "not shut"
        elif name in BLOCKING and value > 0.0:
            chamber = 1 + BLOCKING.index(name)
            found[f"blocking valve {chamber}"] = "shut" if value == 1.0 else "not open"
        elif name == _THROTTLE and value > _FREE:
            found["return throttle"] = f"at {100.0 * value:.0f} % of its way"
        elif name == "pump_loaded" and value == 1.0:
            found["pump"] = "loaded"
        elif name == "drive_state" and value == value and int(value) & H:
            known = int(value) in set(DriveState)
            found["valve drive"] = DriveState(int(value)).name if known else f"state {value:g}"
    return found
