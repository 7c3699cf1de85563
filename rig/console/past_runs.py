"""The runs below a console's folder, by the first and the last lines of their journals."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from rig.control_socket import remark_of
from rig.unique_keys import json_of

JOURNAL: Final = "journal.jsonl"
MOST_RUNS: Final = 8
"""Most runs of a kind that are offered; they are the newest ones."""
MOST_JOURNALS: Final = 50
"""Most journals that are looked at, those that have changed last."""
MOST_TEXT: Final = 200
"""Most characters of a name, or of a remark, that are shown."""
TAIL_BYTES: Final = 1 << 20
"""Bytes at a journal's end that are read to find its last line, and the longest first line."""
ENDED_BADLY: Final = (1, 3)
"""Exit codes of runs at whose end somebody should look: a test failed, or it tripped or stopped."""


class Ends(NamedTuple):
    """The first and the last complete entry of a journal; {} for one that is not there.

    The last one is that before any entries by which somebody has acknowledged it since, of which
    `acknowledged` is the newest.
    """

    begun: Mapping[str, Any]
    last: Mapping[str, Any]
    acknowledged: Mapping[str, Any]


def ends_of(journal: Path) -> Ends:
    """Return the ends of a journal; a file that cannot be read has none."""
    with suppress(OSError), journal.open("rb") as file:
        first = _entry(file.readline(TAIL_BYTES)) or {}
        file.seek(max(0, journal.stat().st_size - TAIL_BYTES))
        acknowledged: Mapping[str, Any] = {}
        for line in reversed(file.read().splitlines()):
            entry = _entry(line)
            if entry is None:
                continue
            if entry.get("kind") != "operator" or entry.get("request") != "acknowledge":
                return Ends(first, entry, acknowledged)
            acknowledged = acknowledged or entry
        return Ends(first, {}, acknowledged)
    return Ends({}, {}, {})


class PastRuns(NamedTuple):
    """Runs that an operator can still do something about, by `folder` (name) and `campaign`.

    Of each kind there are at most `MOST_RUNS`, the newest first.

    Attributes:
        unfinished: runs that did not reach their end. They were stopped or killed, or are still
            under way: by their journals these look the same.
        unseen: runs that ended badly and that nobody has acknowledged since, with the reason
            (`reason`) and time (`at`, ISO 8601) of the end.
        seen: runs that somebody has acknowledged after their end, with who did, when (`at`, ISO
            8601) and the remark (`text`).
    """

    unfinished: list[dict[str, str]]
    unseen: list[dict[str, str]]
    seen: list[dict[str, str]]


def past_runs(folder: Path) -> PastRuns:
    """Return the runs below a folder that can be gone on with, or that want to be acknowledged."""
    unfinished, unseen, seen = [], [], []
    for run, ends in _runs_in(folder):
        has_ended = ends.last.get("kind") == "end"
        if not has_ended or ends.last.get("reason"):
            unfinished.append(run)
        if has_ended and ends.last.get("exit_code") in ENDED_BADLY and not ends.acknowledged:
            at, reason = (str(ends.last.get(key) or "")[:MOST_TEXT] for key in ("at", "reason"))
            unseen.append(run | {"at": at, "reason": reason})
        if ends.acknowledged:
            seen.append(run | _acknowledgement(ends.acknowledged))
    return PastRuns(unfinished[:MOST_RUNS], unseen[:MOST_RUNS], seen[:MOST_RUNS])


def _acknowledgement(entry: Mapping[str, Any]) -> dict[str, str]:
    """Return by whom, when and with which remark a run was acknowledged."""
    who, person, text = (str(entry.get(key) or "") for key in ("who", "person", "text"))
    remark = remark_of(text, person)[:MOST_TEXT]
    return {"by": (person or who)[:MOST_TEXT], "at": str(entry.get("at") or ""), "text": remark}


def _runs_in(folder: Path) -> Iterator[tuple[dict[str, str], Ends]]:
    """Yield the newest runs, by `folder` (name) and `campaign`, with the ends of their journals.

    Those whose journals have changed last come first.
    """
    journals = sorted(folder.glob(f"*/{JOURNAL}"), key=_modified, reverse=True)
    for journal in journals[:MOST_JOURNALS]:
        ends = ends_of(journal)
        if ends.begun.get("kind") == "begin" and "campaign" in ends.begun:
            campaign = str(ends.begun["campaign"])[:100]
            yield {"folder": journal.parent.name, "campaign": campaign}, ends


def _modified(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _entry(line: bytes) -> Mapping[str, Any] | None:
    """Return the entry in a line of a journal, {} if it is no map; None if the line is no JSON."""
    with suppress(ValueError):
        entry = json_of(line)
        return entry if isinstance(entry, dict) else {}
    return None
