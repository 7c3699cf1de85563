"""A journal's line of a right checksum that says something of a wrong type is refused by name."""

from pathlib import Path
from typing import Any

import pytest

from rig.runner import Status
from rig.runner.outcomes.outcome import TestOutcome
from rig.runner.outcomes.outcome_record import outcome_of, record_of
from rig.runner.run_folder.acknowledging import acknowledge_ended
from rig.runner.run_folder.journal import Entry, Journal, JournalError
from rig.runner.run_folder.resuming import acknowledged, begun_in, standing_of

AT = "2026-11-27T10:00:00+00:00"
OUTCOME = record_of(TestOutcome("one", "healthy", Status.FAILED, 1, 5.0, recording="one.mcap"))
ENTRIES: dict[str, dict[str, Any]] = {
    "begin": {
        "tests": ["one", "two"], "campaign": "c", "started": AT, "fingerprint": {"rig": "0"},
        "versions": {"rig": "1"}, "given": {"reference": "c", "rig": None}, "by": "Anna",
    },
    "phase": {"test": 0, "phase": "setup", "kept": "one~1.mcap", "recording": "one.mcap"},
    "outcome": {"test": 0, "outcome": OUTCOME},
    "operator": {
        "request": "retry", "who": "root", "text": "oil", "test": 0, "person": "Anna",
        "seen": ["a"],
    },
    "held": {"reasons": ["cold"]},
    "released": {"after_s": 1.5},
    "refused": {"why": "no"},
    "driven": {"what": "valve"},
    "limit": {"what": "beyond"},
    "control": {"test": 0, "at_s": 1.5, "who": "root", "what": "gain"},
    "resume": {"started": AT, "versions_changed": "", "by": "Ben"},
    "end": {"reason": "SIGINT", "exit_code": 3},
}  # fmt: skip
WRONG: tuple[Any, ...] = (True, -1, 10**30, 1.5, "../x", [], [1], {}, {"x": 1})
READ_AS_IT_IS = {
    ("begin", "started"), ("resume", "started"), ("begin", "versions"), ("begin", "given"),
    ("begin", "fingerprint"), ("operator", "seen"), ("held", "reasons"), ("begin", "tests"),
    ("outcome", "outcome"), ("phase", "phase"), ("operator", "request"),
}  # fmt: skip
"""Details of which some of these values are right, or of which another test is."""


def journal(changed: str, detail: str, value: object) -> list[Entry]:
    return [
        Entry(n, AT, kind, details | ({detail: value} if kind == changed else {}))
        for n, (kind, details) in enumerate(ENTRIES.items())
    ]


def test_a_journal_of_every_kind_of_entry_is_read() -> None:
    assert len(standing_of(journal("", "", None)).history) == 10


@pytest.mark.parametrize("kind", ENTRIES)
def test_every_detail_of_a_wrong_type_is_read_or_refused_and_never_breaks_the_reader(
    kind: str,
) -> None:
    for detail, right in ENTRIES[kind].items():
        for value in WRONG:
            try:
                standing_of(journal(kind, detail, value))
                is_refused = False
            except ValueError:
                is_refused = True
            a_number_too = isinstance(right, int | float) and type(value) in (int, float)
            a_text_too = isinstance(right, str) and isinstance(value, str)
            if (kind, detail) not in READ_AS_IT_IS and not (a_number_too or a_text_too):
                assert is_refused, (kind, detail, value)


@pytest.mark.parametrize(
    ("kind", "detail", "value"),
    [
        ("end", "exit_code", "3"), ("end", "exit_code", True), ("begin", "given", {"rig": 7}),
        ("operator", "text", 7), ("control", "test", 2), ("control", "test", 10**30),
        ("operator", "test", -1), ("phase", "recording", "../one.mcap"), ("phase", "test", True),
    ],
)  # fmt: skip
def test_what_is_of_a_wrong_type_is_named(kind: str, detail: str, value: object) -> None:
    with pytest.raises(ValueError, match=rf"{kind}: {detail}|the test .* of 2"):
        standing_of(journal(kind, detail, value))


@pytest.mark.parametrize("name", OUTCOME)
def test_an_outcome_of_a_wrong_type_is_no_outcome_or_another_one(name: str) -> None:
    for value in (None, *WRONG):
        try:
            outcome_of({**OUTCOME, name: value})
        except ValueError:
            continue


@pytest.mark.parametrize("detail", ["tests", "given"])
def test_commands_tell_that_the_journal_is_no_campaign_s(tmp_path: Path, detail: str) -> None:
    with Journal(tmp_path) as written:
        written.write("begin", **(ENTRIES["begin"] | {detail: 7}))
    for read in (begun_in, lambda folder: acknowledge_ended(folder, "root")):
        with pytest.raises(JournalError, match=f"is not a campaign's journal .*begin: {detail}"):
            read(tmp_path)
    assert acknowledged(tmp_path) == ()
