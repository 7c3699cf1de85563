"""Keeps what a rig has done in a file of this user, over runs, kills and resumptions."""

import json
import os
import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK
from rig.recording import read_bounded, replacing
from rig.unique_keys import RepeatedLineError, json_of

from .motion import Counted, MotionCounter

_SCHEMA: Final = "hydraulic-rig counters"
_WRITE_EVERY: Final = round(1.0 / TICK)
"""Samples after which the file is written: a kill loses a second of counting at most."""


class CounterError(Exception):
    """The error of a file of counters that cannot be read."""


@dataclass(frozen=True)
class Counters:
    """What a rig has done in all, and when it was maintained last.

    Attributes:
        rig: name of the rig.
        since: when counting began, UTC, ISO 8601.
        total: what the rig has done since then.
        maintained: when the last maintenance was noted, UTC, ISO 8601; empty if none was.
        maintenance: what was done then, in the words of who noted it.
        at_maintenance: the totals then.
    """

    rig: str
    since: str
    total: Counted = field(default_factory=Counted)
    maintained: str = ""
    maintenance: str = ""
    at_maintenance: Counted = field(default_factory=Counted)

    @property
    def since_maintenance(self) -> Counted:
        """What the rig has done since its last maintenance, or since counting began."""
        return self.total - self.at_maintenance

    def lines(self) -> list[str]:
        """Return the counters as lines of text."""
        lines = [f"{self.rig}: {self.total} since {self.since}"]
        if self.maintained:
            words = f" ({self.maintenance})" if self.maintenance else ""
            lines.append(
                f"  {self.since_maintenance} since the maintenance of {self.maintained}{words}"
            )
        return lines


def counters_path(rig: str) -> Path:
    """Return the file of a rig's counters, in the folder of this user's state."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "hydraulic-rig" / "counters" / f"{re.sub(r'[^A-Za-z0-9_.-]', '_', rig)}.json"


def read_counters(rig: str, path: Path | None = None) -> Counters:
    """Return the counters of a rig; those of a rig that has done nothing if there is no file.

    Raises:
        CounterError: the file cannot be read, or is none of counters.
    """
    path = path or counters_path(rig)
    try:
        content = json_of(read_bounded(path))
        return Counters(
            rig=rig,
            since=str(content["since"]),
            total=_counted(content["total"]),
            maintained=str(content["maintained"]),
            maintenance=str(content["maintenance"]),
            at_maintenance=_counted(content["at_maintenance"]),
        )
    except FileNotFoundError:
        return Counters(rig, _now())
    except RepeatedLineError as error:
        raise CounterError(error.at(path)) from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        reason = f"{type(error).__name__}: {error}"
        raise CounterError(
            f"{path}: is no file of counters ({reason}); mend it, or move it away to count from 0"
        ) from None


def _counted(content: Any) -> Counted:
    found = Counted(*(float(content[name]) for name in ("cycles", "metres", "hours")))
    if not all(0.0 <= value < np.inf for value in asdict(found).values()):
        raise ValueError("a count is below 0 or not finite")
    return found


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def write_counters(counters: Counters, path: Path, *, durable: bool = True) -> None:
    """Write the counters of a rig, replacing their file in one step.

    Raises:
        OSError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps({"schema": _SCHEMA, **asdict(counters)}, indent=1, ensure_ascii=False)
    with replacing(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(text + "\n")
        if durable:
            file.flush()
            os.fsync(file.fileno())


def note_maintenance(rig: str, words: str) -> Counters:
    """Note that a rig was maintained now, write that to its file, and return its counters.

    Raises:
        CounterError: the file cannot be read.
        OSError: the file cannot be written.
    """
    known = read_counters(rig)
    noted = replace(
        known, maintained=_now(), maintenance=" ".join(words.split()), at_maintenance=known.total
    )
    write_counters(noted, counters_path(rig))
    return noted


class RigCounter:
    """Counts what a rig does in a campaign, and keeps the sum in the rig's file.

    Nothing that is wrong with the file stops a test: the operator is told of it once. A file that
    cannot be read is kept under another name.

    Args:
        rig: name of the rig.
        path: the rig's file; None to keep nothing, as for a simulated rig, which does not wear.
        say: shows a line to the operator.
    """

    def __init__(self, rig: str, path: Path | None, say: Callable[[str], None]) -> None:
        self._path, self._say, self._told = path, say, False
        self._motion, self._unwritten = MotionCounter(), 0
        self._began = Counted()
        self._known = Counters(rig, _now())
        if path is not None:
            try:
                self._known = read_counters(rig, path)
            except CounterError as error:
                kept = path.with_name(f"{path.name}.unreadable")
                with suppress(OSError):
                    path.replace(kept)
                say(f"{error}; it is kept as {kept.name}, and the counters begin anew")

    def begins(self, *, anew: bool) -> None:
        """Begin a test; `anew` if its rig is a new one, whose position does not go on."""
        self.save()
        if anew:
            self._known = replace(self._known, total=self._known.total + self._motion.counted)
            self._motion = MotionCounter()
        self._began = self._motion.counted

    def take(self, position: NDArray[np.float64]) -> None:
        """Process the next samples of the position, m, (n,)."""
        self._motion.take(position)
        self._unwritten += position.size
        if self._unwritten >= _WRITE_EVERY:
            self.save(durable=False)

    @property
    def in_test(self) -> Counted:
        """What was counted since the present test began."""
        return self._motion.counted - self._began

    def save(self, *, durable: bool = True) -> None:
        """Write the rig's file, if there is anything new to write."""
        if self._path is None or not self._unwritten:
            return
        self._unwritten = 0
        counters = replace(self._known, total=self._known.total + self._motion.counted)
        try:
            write_counters(counters, self._path, durable=durable)
        except OSError as error:
            if not self._told:
                self._say(f"{self._path}: the rig's counters cannot be written ({error})")
            self._told = True
