"""Records in the journal of a run that has ended that somebody has seen how it ended."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .entry_types import check_types
from .journal import JOURNAL, Entry, Journal, JournalError, not_of_a_campaign, read_journal

_UNSEEN = frozenset({"failed", "error", "tripped", "interrupted"})
"""Statuses of tests at whose ends somebody should look."""


def acknowledge_ended(folder: Path, who: str, text: str = "", person: str = "") -> str:
    """Write to a run's journal that somebody has seen what went wrong; return a sentence on that.

    The entry is the one that a running campaign writes for the same request. It changes nothing
    else: a run that can be resumed still can.

    Args:
        folder: folder of a run that has ended.
        who: name of the user or program that asks.
        text: a remark; may be empty.
        person: name of who asks, if several people use that program; else empty.

    Raises:
        JournalError: no campaign was begun in the folder, a campaign is running in it, or its
            journal cannot be read or written, or is not that of a campaign.
    """
    if not read_journal(folder / JOURNAL):
        raise JournalError(f"{folder}: no campaign was begun in it; give the folder of a run")
    try:
        with Journal(folder, resume=True) as journal:
            try:
                for entry in journal.entries:
                    check_types(entry)
            except ValueError as error:
                raise not_of_a_campaign(folder, error) from None
            seen = _wanting_attention(journal.entries)
            details: dict[str, Any] = {"person": person} if person else {}
            details |= {"text": text} if text else {}
            journal.write("operator", request="acknowledge", who=who, **details, seen=seen)
    except OSError as error:
        raise JournalError(f"{folder}: the journal cannot be written: {error.strerror}") from None
    return f"acknowledged: {'; '.join(seen)}" if seen else "acknowledged"


def _wanting_attention(entries: Sequence[Entry]) -> list[str]:
    """Return what of a run wants to be seen, "NAME: STATUS" each, and why it was stopped."""
    names: Sequence[str] = ()
    statuses: dict[int, str] = {}
    reason = ""
    for entry in entries:
        match entry.kind:
            case "begin":
                names = entry["tests"] or ()
            case "outcome":
                statuses[entry["test"]] = entry["outcome"]["status"]
            case "resume":
                reason = ""
            case "end":
                reason = str(entry["reason"] or "")
    found = [
        f"{names[index]}: {status}"
        for index, status in sorted(statuses.items())
        if status in _UNSEEN and index < len(names)
    ]
    return [*found, f"stopped by {reason}"] if reason else found
