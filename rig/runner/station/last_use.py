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
MOST_UNSEEN: Final = 8
"""Most earlier trips that are kept until somebody has acknowledged them, the newest ones."""


class LastUse:
    """What drove a rig last and how that ended, as `content`, until somebody drives it again.

    Whoever drives it says in the end how that was, as in the last messages of its live stream. That
    a run was acknowledged stands in the run's own journal; of what has no journal, such as homing,
    it stands here. A trip that nobody has acknowledged stays in the content, as one of `unseen`,
    also when the rig is driven again.

    Its methods may be called from any thread.

    Args:
        folder: the station's folder, which exists.
        say: takes a line, for the station's log, on what could not be kept.
    """

    def __init__(self, folder: Path, say: Callable[[str], None]) -> None:
        self._path = folder / LAST
        self._say = say
        self._lock = threading.RLock()
        """Held while the content changes and is written: two writers would share one file."""
        self._content = _kept(self._path)
        self._looked_at = 0.0
        self._journals_ns: dict[Path, int] = {}
        """When the journals had changed that were read last, by folder."""
        self._is_new = True

    @property
    def content(self) -> Mapping[str, Any]:
        """The content as docs/stream.md describes `last`; {} if nothing has driven the rig yet."""
        content = self._content
        unseen = [_without_folder(trip) for trip in content.get("unseen", [])]
        return _without_folder(content) | ({"unseen": unseen} if content else {})

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
        with self._lock:
            self._become({"campaign": campaign, "ended_ns": None, "unseen": self._unseen()})

    def ended(self, lease: Lease) -> None:
        """Take what somebody has said who drove the rig, or that he died without a word."""
        with self._lock:
            said, lease.told = lease.told, None
            kept = {"unseen": self._content.get("unseen", []), "ended_ns": time.time_ns()}
            if said is not None:
                known = {name: said[name] for name in ("campaign", "decision", "trips", "folder")}
                self._become({**known, **kept})
            elif self._content.get("ended_ns") is None:
                died = {} if lease.said_end else {"exit_code": EXIT_STOPPED, "reason": DIED}
                self._become({"campaign": {**self._content["campaign"], **died}, **kept})

    def acknowledge(self, who: str, person: str, text: str) -> str:
        """Keep that somebody has seen how it ended; return why that is not done, or "".

        Args:
            who: the user or program that says so.
            person: who gave the order, if several people use that program; else empty.
            text: the order's text, which may begin with the person's name.
        """
        with self._lock:
            unseen = self._content.get("unseen", [])
            is_seen = not self._content or bool(self._content.get("acknowledged"))
            if is_seen and not unseen:
                return SEEN_ALREADY
            remark = remark_of(text, person)
            uses = [*unseen, *([] if is_seen else [self._content])]
            # A run that tripped, went on and tripped again is in one folder.
            for folder in filter(None, dict.fromkeys(map(_folder, uses))):
                try:
                    acknowledge_ended(folder, who, remark, person)
                except JournalError as error:
                    return str(error)
            seen = {"by": person or who, "at_ns": time.time_ns(), "text": remark}
            self._become({"acknowledged": seen, **self._content, "unseen": []})
            return ""

    def look(self) -> bool:
        """Return whether the content is another one than at the last call.

        Once a second it is looked whether the run was acknowledged elsewhere.
        """
        with self._lock:
            now = time.monotonic()
            if now - self._looked_at >= LOOK_S:
                self._looked_at = now
                self._read_journals()
            is_new, self._is_new = self._is_new, False
        return is_new

    def _unseen(self) -> list[dict[str, Any]]:
        """Return the trips up to now that nobody has acknowledged, the newest last."""
        unseen = list(self._content.get("unseen", []))
        first = _first_out(self._content)
        if first and not self._content.get("acknowledged"):
            campaign = self._content["campaign"]
            known = {name: campaign.get(name, "") for name in ("name", "activity", "begun_by")}
            kept = {name: self._content.get(name) for name in ("ended_ns", "folder")}
            unseen.append({**known, **kept, "sentence": first.get("sentence", "")})
        return unseen[-MOST_UNSEEN:]

    def _read_journals(self) -> None:
        """Note which runs were acknowledged elsewhere, as their journals say."""
        unseen = self._content.get("unseen", [])
        left = [trip for trip in unseen if self._seen(trip) is None]
        if len(left) < len(unseen):
            self._become({**self._content, "unseen": left})
        seen = None if self._content.get("acknowledged") else self._seen(self._content)
        if seen is not None:
            self._become({**self._content, "acknowledged": seen})

    def _seen(self, use: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return who has acknowledged a use's run, if its journal has changed and says so."""
        folder = _folder(use)
        if folder is None:
            return None
        try:
            changed_ns = (folder / JOURNAL).stat().st_mtime_ns
        except OSError:
            return None
        if changed_ns == self._journals_ns.get(folder):
            return None
        self._journals_ns[folder] = changed_ns
        try:
            entries = read_journal(folder / JOURNAL)
        except JournalError:
            return None
        last = entries[-1] if entries else None
        has_ended = any(entry.kind == "end" for entry in entries)
        if last is None or not has_ended or last["request"] != "acknowledge":
            return None
        person = str(last["person"] or "")
        text = remark_of(str(last["text"] or ""), person)
        return {"by": person or str(last["who"]), "at_ns": changed_ns, "text": text}

    def _become(self, content: Mapping[str, Any]) -> None:
        """Change the content, with the lock held, and write it."""
        folders = [_folder(use) for use in (content, *content.get("unseen", []))]
        self._journals_ns = {k: ns for k, ns in self._journals_ns.items() if k in folders}
        self._content = content
        self._is_new = True
        try:
            replace_text(self._path, json.dumps(content, ensure_ascii=False))
        except OSError as error:
            self._say(f"{self._path} cannot be written: {refusal(error, '--runs')}")


def _without_folder(use: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in use.items() if name != "folder"}


def _first_out(use: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what tripped first in a use; {} if nothing did, or that is not what it should be."""
    trips = use.get("trips")
    first = trips.get("first_out") if isinstance(trips, dict) else None
    return first[0] if isinstance(first, list) and first and isinstance(first[0], dict) else {}


def _folder(use: Mapping[str, Any]) -> Path | None:
    """Return the folder of a use's run, if its journal is there."""
    folder = Path(str(use.get("folder") or ""))
    return folder if folder.is_absolute() and (folder / JOURNAL).is_file() else None


def _kept(path: Path) -> Mapping[str, Any]:
    """Return what is in a file of an earlier station; {} if there is none, or nothing readable."""
    try:
        found = json_of(read_bounded(path, LONGEST_WORD))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict) or not isinstance(found.get("campaign"), dict):
        return {}
    unseen = found.get("unseen")
    trips = [trip for trip in unseen if isinstance(trip, dict)] if isinstance(unseen, list) else []
    return {**found, "unseen": trips}
