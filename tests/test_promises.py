"""Every promise of docs/safety.md and docs/stream.md names a test that is there."""

import re

import pytest

from rig.configuration.rigs.stream import AccessFile, LoginFile, StreamFile, TlsFile
from rig.stream.fields import FIELDS, HEADER
from tests.promises import (
    LISTED,
    ROOT,
    Entry,
    Promise,
    all_promises,
    entries,
    problems,
    promises_of,
    written_tests,
)

STREAM = (ROOT / "docs" / "stream.md").read_text(encoding="utf-8")
PROMISE = Promise("safety.md", "The ram stops.")
ENTRY = Entry("safety.md", "The ram", ["test_it_stops"], "")


def test_every_promise_names_a_test_that_exists_or_says_why_it_has_none() -> None:
    promises = all_promises()
    assert len(promises) > 150
    assert problems(promises, entries(LISTED.read_text(encoding="utf-8")), written_tests()) == []


@pytest.mark.parametrize(
    ("promises", "listed", "written", "said"),
    [
        ([PROMISE], [ENTRY], {"test_it_stops"}, None),
        ([PROMISE], [], set(), "no test is named of"),
        ([PROMISE], [ENTRY], set(), "test_it_stops does not exist"),
        ([PROMISE], [ENTRY._replace(page="stream.md")], {"test_it_stops"}, "no test is named"),
        ([], [ENTRY], {"test_it_stops"}, "0 promises begin with 'The ram'"),
        ([PROMISE], [ENTRY._replace(without="told twice")], {"test_it_stops"}, "one of them"),
    ],
)
def test_what_names_no_test_or_one_that_is_not_there_is_told(
    promises: list[Promise], listed: list[Entry], written: set[str], said: str | None
) -> None:
    found = problems(promises, listed, written)
    assert found == [] if said is None else any(said in each for each in found)


def test_paragraphs_items_and_rows_are_promises_and_code_is_none() -> None:
    text = (
        "# Page\n\nIt stops.\nAt once.\n\n- one\n- two\n  lines\n\n"
        "| what | when |\n|---|---|\n| ram | now |\n\n    code\n\n```\nmore code\n```\n"
        "<!-- table of causes -->\n| a | b |\n|---|---|\n| c | d |\n<!-- end -->\n"
    )
    told = [promise.text for promise in promises_of("safety.md", text)]
    assert sorted(told) == [
        "- one", "- two lines", "It stops. At once.", "table of causes", "| ram | now |",
    ]  # fmt: skip


def rows_of(heading: str) -> dict[str, str]:
    """Return first cell -> last cell of a table's rows, by the table's head."""
    table = STREAM.partition(heading)[2].partition("\n\n")[0]
    cells = [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]
    return {row[0].strip("`"): row[-1] for row in cells}


def test_the_stream_s_page_tells_of_every_kind_of_message_and_no_key_that_is_not_there() -> None:
    told = rows_of("| kind | when | holds |")
    assert set(told) == set(FIELDS)
    assert set(rows_of("| in every message | |")) == set(HEADER)
    for kind in ("channels", "samples", "event", "state"):
        named = set(re.findall(r"`(\w+)`", told[kind]))
        assert set(FIELDS[kind]) <= named, kind


def test_the_stream_s_page_tells_of_every_key_of_a_profile() -> None:
    told = rows_of("| key | value |")
    named = {name for key in told for name in re.findall(r"\w+", key)}
    assert set(StreamFile.model_fields) - {"name", "description"} == named
    for key, file in (("tls", TlsFile), ("login", LoginFile), ("access", AccessFile)):
        assert set(file.model_fields) <= set(re.findall(r"`(\w+)`", told[key])), key
