"""The log of a station: a line for all that happens, in files whose size is bounded."""

import json
import os
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rig.reserves import refusal

LOG: Final = "station.jsonl"
"""Name of the log in the station's folder."""
LONGEST: Final = 1_000_000
"""Bytes after which the log is begun anew; the one before is kept beside it, as `station.jsonl.1`.

A line has some 150 bytes, so that both together hold about 13 000 of them: a rig that is lost, and
tried every 30 s with a line for each, would fill them in four days.
"""
TRIP_REPORTS: Final = 20
"""Trip reports of its idle time that a station keeps, the newest."""


class StationLog:
    """The log of a station, to which each call of `write` appends a JSON line.

    A line has `at` (UTC), `kind` and `text`. If it cannot be written, that is told once until it
    can be written again; the station goes on.

    Args:
        folder: the station's folder, which exists.
        say: shows a line to the operator.
        longest: bytes after which a file is begun anew.
    """

    def __init__(self, folder: Path, say: Callable[[str], None], longest: int = LONGEST) -> None:
        self._path = folder / LOG
        self._say = say
        self._longest = longest
        self._fails = False

    def write(self, kind: str, text: str) -> None:
        """Append what has happened, and show it to the operator."""
        self._say(text)
        at = datetime.now(UTC).isoformat(timespec="milliseconds")
        line = json.dumps({"at": at, "kind": kind, "text": text}, ensure_ascii=False)
        try:
            with self._path.open("a", encoding="utf-8") as file:
                file.write(f"{line}\n")
                long = file.tell() >= self._longest
            if long:
                os.replace(self._path, self._path.with_name(f"{LOG}.1"))
        except OSError as error:
            if not self._fails:
                self._say(f"station: {self._path} cannot be written: {refusal(error, '--runs')}")
            self._fails = True
        else:
            self._fails = False


def keep_newest(folder: Path, session_log: str) -> None:
    """Remove all but the newest trip reports of a station's folder, and bound its session's log.

    Args:
        folder: the station's folder.
        session_log: name of the file that takes what the session's processes print.
    """
    reports = sorted(folder.glob("trip*"), key=lambda path: (path.stat().st_mtime, path.name))
    named = list(dict.fromkeys(path.name.split(".")[0] for path in reports))
    old = set(named[: max(len(named) - TRIP_REPORTS, 0)])
    for path in reports:
        if path.name.split(".")[0] in old:
            path.unlink(missing_ok=True)
    log = folder / session_log
    if log.exists() and log.stat().st_size > LONGEST:
        os.replace(log, log.with_name(f"{session_log}.1"))
