"""Journal and reason name the person who acted, not the key or the program by which that was."""

from typing import Any

import pytest

from rig.runner.campaign.operator_requests import Desk, Request
from rig.runner.campaign.stopping import StopFlag
from rig.runner.run_folder.journal import Entry
from rig.runner.run_folder.resuming import standing_of
from rig.stream.commands import Credentials, Gate, Sender

BEGIN = Entry(0, "2026-11-27T10:00:00+00:00", "begin", {"tests": ["one"]})


@pytest.mark.parametrize(
    ("text", "reason"), [("Anna", "Anna"), ("Anna: enough", "Anna: enough"), ("", "Anna")]
)
def test_the_closing_reason_names_the_person_who_stopped_it(text: str, reason: str) -> None:
    desk, stop = Desk(), StopFlag()
    written: list[dict[str, Any]] = []
    desk.open(["one"], {}, lambda kind, **told: written.append(told), stop)
    desk.ask(Request.ABORT, "local", text, person="Anna")
    assert stop.reason == reason
    assert (written[0]["who"], written[0]["person"]) == ("local", "Anna")


def test_without_a_person_the_sender_is_named_as_before() -> None:
    desk, stop = Desk(), StopFlag()
    written: list[dict[str, Any]] = []
    desk.open(["one"], {}, lambda kind, **told: written.append(told), stop)
    desk.ask(Request.ABORT, "ann", "enough")
    assert stop.reason == "ann: enough"
    assert written == [{"request": "abort", "who": "ann", "text": "enough"}]


def test_who_began_a_run_and_who_went_on_with_it_stand_in_its_history() -> None:
    begun = Entry(0, BEGIN.at, "begin", {"tests": ["one"], "by": "Anna"})
    resumed = Entry(1, BEGIN.at, "resume", {"versions_changed": "", "by": "Ben"})
    history = standing_of([begun, resumed]).history
    assert [(each.who, each.what) for each in history] == [("Anna", "begun"), ("Ben", "resumed")]
    assert standing_of([BEGIN]).history == []


def test_a_command_carries_who_gave_it_and_one_without_is_as_it_was() -> None:
    local = Credentials("local", bytes(32))
    gate = Gate("bench", "s1", {"local": (local, frozenset({"abort"}))})
    sender = Sender(local)
    by_anna = gate.judge("abort", sender.sign("bench", "s1", "abort", "x", person="Anna\nM."))
    assert (by_anna.by, by_anna.text, by_anna.person) == ("local", "x", "Anna M.")
    assert gate.judge("abort", sender.sign("bench", "s1", "abort")).person == ""
