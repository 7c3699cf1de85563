"""Trials are blind, kept, gone on with, and summed up; the workflow here is made up."""

import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest

from tools.hidden_effects.__main__ import main
from tools.hidden_effects.menu import MENU
from tools.hidden_effects.off_menu import OFF_MENU
from tools.hidden_effects.tables import by_effect, summary
from tools.hidden_effects.trials import Plan, kept_file, plans, read_trials, run_trials, trial
from tools.hidden_effects.workflow import WorkflowFailedError, in_process, rig_gap

SECONDS = 1.0


class Guessing:
    """A workflow that always answers the same, and remembers what it was given."""

    def __init__(self, verdict: str, *names: str) -> None:
        self.effects = [{"name": name, "parameters": {}} for name in names]
        self.verdict = verdict
        self.seen: list[str] = []
        self.discovered: list[dict[str, str]] = []

    def __call__(self, identify: Sequence[Path], holdout: Path, out: Path) -> Mapping[str, Any]:
        assert len(identify) == 2
        root = holdout.parents[1]
        self.seen += [str(path.relative_to(root.parent)) for path in root.rglob("*")]
        gap = {"before": 2.0, "after": 1.0}
        found = {"verdict": self.verdict, "effects": self.effects, "gap": gap}
        return {**found, "discovered": self.discovered}


def failing(identify: Sequence[Path], holdout: Path, out: Path) -> Mapping[str, Any]:
    raise WorkflowFailedError("no power")


def test_the_workflow_is_shown_nothing_of_what_is_hidden(tmp_path: Path) -> None:
    judge = Guessing("adequate")
    run_trials(plans(4, 1, seconds=SECONDS), tmp_path, 1, workflow=judge)
    assert judge.seen
    hints = ("single", "none", "double", "off_menu", "envelope", *MENU, *OFF_MENU)
    assert not [name for name in judge.seen if any(hint in name for hint in hints)]


def test_a_mixture_has_every_kind() -> None:
    assert {plan.kind for plan in plans(18, 1)} == {
        "single", "double", "none", "off_menu", "unexcited",
    }  # fmt: skip
    assert len({plan.key for plan in plans(200, 1)}) == 200


def test_a_study_goes_on_where_it_was_stopped(tmp_path: Path) -> None:
    planned = plans(3, 1, "single", SECONDS)
    first = run_trials(planned, tmp_path, 1, workflow=Guessing("adequate"))
    file = kept_file(tmp_path)
    lines = file.read_text().splitlines(keepends=True)
    # Killed within the last line.
    file.write_text("".join(lines[:2]) + lines[2][:50] + "\n")
    judge = Guessing("inconclusive")
    again = run_trials(planned, tmp_path, 1, workflow=judge)
    assert again[:2] == first[:2]
    assert again[2].score.verdict == "inconclusive"
    assert len(read_trials(file)) == 3
    assert {name.split("/")[0] for name in judge.seen} == {"trial-0002"}


def test_a_trial_that_failed_is_run_again(tmp_path: Path) -> None:
    planned = plans(1, 1, "single", SECONDS)
    run_trials(planned, tmp_path, 1, workflow=failing)
    (again,) = run_trials(planned, tmp_path, 1, workflow=Guessing("adequate"))
    assert again.score.outcome == "missed"
    assert read_trials(kept_file(tmp_path))[again.plan.key] == again


def test_recordings_are_left_where_the_workflow_failed(tmp_path: Path) -> None:
    plan = Plan("single", 1, 0, SECONDS)
    found = trial(plan, tmp_path / "a", workflow=failing)
    assert (found.score.outcome, found.score.why) == ("failed", "no power")
    assert json.loads((tmp_path / "a/envelope.json").read_text())["effects"]
    assert (tmp_path / "a/recordings/holdout.csv.gz").exists()
    trial(plan, tmp_path / "b", workflow=Guessing("adequate"))
    assert not (tmp_path / "b").exists()


def test_refusing_recordings_that_show_nothing_is_right(tmp_path: Path) -> None:
    def refusing(identify: Sequence[Path], holdout: Path, out: Path) -> Mapping[str, Any]:
        raise WorkflowFailedError("the ram does not move", refused=True)

    outcomes = [
        trial(Plan(kind, 1, 0, SECONDS), tmp_path, workflow=refusing).score.outcome
        for kind in ("unexcited", "single")
    ]
    assert outcomes == ["right", "failed"]


@pytest.mark.long
def test_tables_say_how_often_the_promises_were_held(tmp_path: Path) -> None:
    # Every effect has one trial of the first 35: one of them is of this one.
    judge = Guessing("missing_effect", "command_delay")
    found = run_trials(plans(35, 1, "single", 0.3), tmp_path, 1, workflow=judge)
    found += run_trials(plans(2, 1, "none", 0.3), tmp_path, 1, workflow=judge)
    table = summary(found)
    assert "| one effect: named, or in a set of at most three | 35 | 3 % (1) | 0 to 15 % |" in table
    assert "| nothing hidden: an effect named | 2 | 100 % (2) | 16 to 100 % |" in table
    assert "| held-out gap gone, median (of gaps above 0.05) | 35 | 50 % |  |" in table
    rows = {line.split("|")[1].strip(): line for line in by_effect(found).splitlines()}
    assert "| command delay | 1 | 1 |" in rows["command delay"]
    assert "command delay 1 |" in rows["supply ripple"]


def test_the_program_prints_its_tables_and_writes_them_into_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "<!-- table of hidden_effects -->\n<!-- end -->\n"
        "<!-- table of hidden_by_effect -->\n<!-- end -->\n"
    )
    arguments = ["--trials", "2", "--kind", "off_menu", "--seconds", "0.5", "--jobs", "1"]
    paths = ["--out", str(tmp_path / "out"), "--page", str(page), "--limits", "3"]
    main([*arguments, *paths], Guessing("unknown_effect"))
    assert "| off the menu: called unknown | 2 | 100 % (2) |" in capsys.readouterr().out
    assert "| off the menu: called unknown | 2 | 100 % (2) |" in page.read_text()


def test_tables_tell_of_other_forms_and_places(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--trials", "2", "--seconds", "0.5", "--jobs", "1", "--out", str(tmp_path)]
    judge = Guessing("missing_effect", "command_delay")
    main([*arguments, "--kind", "single", "--forms", "other"], judge)
    assert "| hidden | form | named (95 %) |" in capsys.readouterr().out
    judge = Guessing("unknown_effect")
    judge.discovered = [{"name": "tone", "equation": "force balance", "of": "time"}]
    main([*arguments, "--kind", "off_menu", "--off-menu", "all"], judge)
    printed = capsys.readouterr().out
    assert "| off the menu: equation and quantity right | 2 |" in printed
    assert "tone in force balance of time 1" in printed
    # What was kept is read again.
    main([*arguments, "--kind", "off_menu", "--off-menu", "all"], failing)
    assert capsys.readouterr().out == printed


@pytest.mark.parametrize(
    ("status", "printed", "said", "message"),
    [
        (1, "", "Traceback\nValueError: no", "left with status 1: ValueError: no"),
        (0, "all well", "", "no JSON"),
        (0, "[1]", "", "no JSON object"),
        (0, "", "", "no JSON"),
    ],
)
def test_a_workflow_without_an_answer_has_failed(
    monkeypatch: pytest.MonkeyPatch, status: int, printed: str, said: str, message: str
) -> None:
    def ended(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        return subprocess.CompletedProcess(command, status, printed, said)

    monkeypatch.setattr(subprocess, "run", ended)
    with pytest.raises(WorkflowFailedError, match=message):
        rig_gap([Path("a"), Path("b")], Path("c"), Path("out"))


def test_the_answer_is_the_last_line_that_rig_gap_prints(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[list[str]] = []

    def ended(command: list[str], **_: Any) -> subprocess.CompletedProcess[str]:
        asked.append(command)
        return subprocess.CompletedProcess(command, 0, 'fitting\n{"verdict": "adequate"}\n', "")

    monkeypatch.setattr(subprocess, "run", ended)
    found = rig_gap([Path("a"), Path("b")], Path("c"), Path("out"))
    assert found == {"verdict": "adequate"}
    assert asked[0][3:] == [
        "gap", "a", "b", "--holdout", "c", "--model", "nominal", "--out", "out", "--json",
    ]  # fmt: skip


def test_a_recording_that_cannot_be_read_is_refused_in_this_process_as_by_the_command(
    tmp_path: Path,
) -> None:
    broken = tmp_path / "identify_1.csv"
    broken.write_text("time_s,command_V,position_m\n0.000,,\n0.001,,\n")
    with pytest.raises(WorkflowFailedError) as failed:
        in_process([broken], broken, tmp_path)
    assert failed.value.refused
