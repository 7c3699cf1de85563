"""The runs below a console's folder, by the first and the last lines of their journals."""

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, Final, NamedTuple

JOURNAL: Final = "journal.jsonl"
MOST_RUNS: Final = 8
"""Most runs of a kind that are offered; they are the newest ones."""
MOST_JOURNALS: Final = 50
"""Most journals that are looked at, those that have changed last."""
TAIL_BYTES: Final = 1 << 20
"""Bytes at a journal's end that are read to find its last line, and the longest first line."""
ENDED_BADLY: Final = (1, 3)
"""Exit codes of runs at whose end somebody should look: a test failed, or it tripped or stopped."""


class Ends(NamedTuple):
    """The first and the last complete entry of a journal; {} for one that is not there.

    The last one is that before any entries by which somebody has acknowledged it since.
    """

    begun: Mapping[str, Any]
    last: Mapping[str, Any]
    acknowledged: bool


def ends_of(journal: Path) -> Ends:
    """Return the ends of a journal; a file that cannot be read has none."""
    with suppress(OSError), journal.open("rb") as file:
        first = _entry(file.readline(TAIL_BYTES)) or {}
        file.seek(max(0, journal.stat().st_size - TAIL_BYTES))
        acknowledged = False
        for line in reversed(file.read().splitlines()):
            entry = _entry(line)
            if entry is None:
                continue
            if entry.get("kind") != "operator" or entry.get("request") != "acknowledge":
                return Ends(first, entry, acknowledged)
            acknowledged = True
        return Ends(first, {}, acknowledged)
    return Ends({}, {}, False)


def unfinished_in(folder: Path) -> list[dict[str, str]]:
    """Return the newest runs that did not reach their end, by `folder` (name) and `campaign`.

    They were stopped or killed, or are still under way: by their journals these look the same. At
    most `MOST_RUNS` are returned, the newest first.
    """
    found = (
        run
        for run, ends in _runs_in(folder)
        # Its journal does not end with an entry `end` without a reason.
        if ends.last.get("kind") != "end" or ends.last.get("reason")
    )
    return list(islice(found, MOST_RUNS))


def unseen_in(folder: Path) -> list[dict[str, str]]:
    """Return the newest runs that ended badly and that nobody has acknowledged since.

    They are given as those of `unfinished_in`, at most `MOST_RUNS`, the newest first.
    """
    found = (
        run
        for run, ends in _runs_in(folder)
        if ends.last.get("kind") == "end" and ends.last.get("exit_code") in ENDED_BADLY
        if not ends.acknowledged
    )
    return list(islice(found, MOST_RUNS))


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
        entry = json.loads(line)
        return entry if isinstance(entry, dict) else {}
    return None
