"""What drove a station's rig last, how that ended, and who has seen it.

It is kept in a file of the station's folder, so that a station that is started again tells it too.
"""

import json
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

from rig.control_socket import remark_of
from rig.recording import read_bounded, replace_text
from rig.reserves import refusal
from rig.runner.outcomes import EXIT_STOPPED
from rig.runner.run_folder import JOURNAL, JournalError, acknowledge_ended, read_journal
from rig.supervisor import LONGEST_WORD, Lease
from rig.unique_keys import json_of

LAST: Final = "last.json"
"""Name of the file in the station's folder."""
NOT_TOLD: Final = "its program has not told the station how it ended"
DIED: Final = "its process died without a word"
SEEN_ALREADY: Final = "nothing that has ended waits to be acknowledged"
LOOK_S: Final = 1.0
"""Period in s at which it is looked whether the run was acknowledged from a terminal."""


class LastUse:
    """What drove a rig last and how that ended, as `content`, until somebody drives it again.

    Whoever drives it says in the end how that was, as in the last messages of its live stream. That
    a run was acknowledged stands in the run's own journal; of what has no journal, such as homing,
    it stands here.

    Args:
        folder: the station's folder, which exists.
        say: takes a line, for the station's log, on what could not be kept.
    """

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self._path = folder / LAST
        self._say = say
        self._lock = threading.Lock()
        self._content = _kept(self._path)
        self._looked_at = 0.0
        self._journal_ns = 0
        self._is_new = True

    @property
    def content(self) -> Mapping[str, Any]:
        """The content as docs/stream.md describes `last`; {} if nothing has driven the rig yet."""
        return {name: value for name, value in self._content.items() if name != "folder"}

    @property
    def name(self) -> str:
        """What drove the rig last; "" if nothing has."""
        return str(self._content.get("campaign", {}).get("name", ""))

    def lent(self, lease: Lease) -> None:
        """Note that somebody drives the rig now, who has not said yet how that ended."""
        campaign = {
            "status": "ended",
            "name": lease.what,
            "activity": lease.what,
            "begun_by": lease.by,
            "begun_ns": round(1e9 * lease.since.timestamp()),
            "exit_code": None,
            "reason": NOT_TOLD,
            "tests": [],
        }
        self._become({"campaign": campaign, "ended_ns": None})

    def ended(self, lease: Lease) -> None:
        """Take what somebody has said who drove the rig, or that he died without a word."""
        said, lease.told = lease.told, None
        if said is not None:
            known = {name: said[name] for name in ("campaign", "decision", "trips", "folder")}
            self._become({**known, "ended_ns": time.time_ns()})
        elif self._content.get("ended_ns") is None:
            died = {} if lease.said_end else {"exit_code": EXIT_STOPPED, "reason": DIED}
            campaign = {**self._content["campaign"], **died}
            self._become({"campaign": campaign, "ended_ns": time.time_ns()})

    def acknowledge(self, who: str, person: str, text: str) -> str:
        """Keep that somebody has seen how it ended; return why that is not done, or "".

        Args:
            who: the user or program that says so.
            person: who gave the order, if several people use that program; else empty.
            text: the order's text, which may begin with the person's name.
        """
        if not self._content or self._content.get("acknowledged"):
            return SEEN_ALREADY
        remark = remark_of(text, person)
        folder = self._folder
        if folder is not None:
            try:
                acknowledge_ended(folder, who, remark, person)
            except JournalError as error:
                return str(error)
        seen = {"by": person or who, "at_ns": time.time_ns(), "text": remark}
        self._become({**self._content, "acknowledged": seen})
        return ""

    def look(self) -> bool:
        """Return whether the content is another one than at the last call.

        Once a second it is looked whether the run was acknowledged elsewhere.
        """
        now = time.monotonic()
        if now - self._looked_at >= LOOK_S:
            self._looked_at = now
            self._read_journal()
        with self._lock:
            is_new, self._is_new = self._is_new, False
        return is_new

    @property
    def _folder(self) -> Path | None:
        """The folder of the run, if its journal is there."""
        folder = Path(str(self._content.get("folder") or ""))
        return folder if folder.is_absolute() and (folder / JOURNAL).is_file() else None

    def _read_journal(self) -> None:
        """Note that the run was acknowledged, if its journal has changed and says so."""
        folder = self._folder
        if folder is None or self._content.get("acknowledged"):
            return
        try:
            changed_ns = (folder / JOURNAL).stat().st_mtime_ns
        except OSError:
            return
        if changed_ns == self._journal_ns:
            return
        self._journal_ns = changed_ns
        try:
            entries = read_journal(folder / JOURNAL)
        except JournalError:
            return
        last = entries[-1] if entries else None
        has_ended = any(entry.kind == "end" for entry in entries)
        if last is None or not has_ended or last["request"] != "acknowledge":
            return
        person = str(last["person"] or "")
        text = remark_of(str(last["text"] or ""), person)
        seen = {"by": person or str(last["who"]), "at_ns": changed_ns, "text": text}
        self._become({**self._content, "acknowledged": seen})

    def _become(self, content: Mapping[str, Any]) -> None:
        self._content = content
        with self._lock:
            self._is_new = True
        try:
            replace_text(self._path, json.dumps(content, ensure_ascii=False))
        except OSError as error:
            self._say(f"{self._path} cannot be written: {refusal(error)}")


def _kept(path: Path) -> Mapping[str, Any]:
    """Return what is in a file of an earlier station; {} if there is none, or nothing readable."""
    try:
        found = json_of(read_bounded(path, LONGEST_WORD))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and isinstance(found.get("campaign"), dict) else {}
