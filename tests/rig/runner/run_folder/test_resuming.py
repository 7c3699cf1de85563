"""A campaign that was stopped or killed goes on: nothing finished is lost or repeated."""

import errno
import json
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from estimator.leaks.detection import Decision
from faults.campaign import Campaign, CampaignTest, OnFault
from rig.configuration.rigs.rig import Rig
from rig.recording import read_recording
from rig.runner import Observer, Status, StopFlag, run_campaign
from rig.runner.outcomes.outcome import TestOutcome
from rig.runner.outcomes.outcome_record import outcome_of, record_of
from rig.runner.run_folder.journal import JOURNAL, Entry, Journal, JournalError, read_journal
from rig.runner.run_folder.resuming import JournalState, standing_of, unfinished_run

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]

SHORT_S = 5.0


class Killed(BaseException):
    """Stands for a kill: nobody catches it."""


class KillsAt(Observer):
    """Ends the process, as far as a run can tell, at a test, and counts the tests that begin."""

    def __init__(self, test: str = "") -> None:
        self._test = test
        self.begun: list[str] = []

    def test_begins(self, number: int, test: CampaignTest) -> None:
        self.begun.append(test.name)

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        if self.begun[-1] == self._test and time_s > 3.0:
            raise Killed


@pytest.fixture
def campaign(make_test: MakeTest, make_campaign: MakeCampaign) -> Campaign:
    """Three short tests."""
    return make_campaign(*(make_test(name, duration_s=SHORT_S) for name in ("one", "two", "three")))


def cut(path: Path, share: float) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: round(share * len(content))])


def killed_in(folder: Path, campaign: Campaign, rig: Rig, test: str) -> None:
    """Leave a folder as a kill in the main phase of a test does."""
    with pytest.raises(Killed):
        run_campaign(campaign, rig, folder, observer=KillsAt(test))
    # A kill writes neither the outcome nor the end; the context managers of this one did.
    entries = (folder / JOURNAL).read_bytes().splitlines(keepends=True)
    whole = [line for line in entries if json.loads(line)["kind"] != "end"]
    last = max(n for n, line in enumerate(whole) if json.loads(line).get("phase") == "main")
    (folder / JOURNAL).write_bytes(b"".join(whole[: last + 1]))


def test_after_a_kill_the_next_unfinished_test_is_run_and_none_that_finished(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    killed_in(tmp_path, campaign, rig, "two")
    before = json.loads((tmp_path / "results.json").read_text())["tests"]
    observer = KillsAt()
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer, resume=True)
    assert observer.begun == ["two", "three"]
    assert [test.name for test in outcome.tests] == ["one", "two", "three"]
    assert {test.status for test in outcome.tests} <= {Status.PASSED, Status.FAILED}
    (attempt,) = outcome.tests[1].attempts
    assert attempt.status is Status.INTERRUPTED
    assert attempt.phase == "main"
    assert attempt.recording == "two~1.mcap"
    assert not outcome.tests[0].attempts
    assert "resumed after a kill in two, main" in [each.what for each in outcome.history]
    after = json.loads((tmp_path / "results.json").read_text())
    assert after["tests"][1]["attempts"][0]["recording"] == "two~1.mcap"
    assert [test["name"] for test in before] == [test["name"] for test in after["tests"]]


def test_a_resumed_campaign_comes_to_the_very_outcomes_of_one_that_was_never_killed(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    whole = run_campaign(campaign, rig, tmp_path / "whole")
    killed_in(tmp_path / "cut", campaign, rig, "three")
    resumed = run_campaign(campaign, rig, tmp_path / "cut", resume=True)

    def figures(test: TestOutcome) -> object:
        return test.decision, test.status, test.recorded_s, test.injected

    assert [figures(test) for test in resumed.tests] == [figures(test) for test in whole.tests]
    for name in ("one.mcap", "three.mcap"):
        one, other = (read_recording(tmp_path / folder / name) for folder in ("whole", "cut"))
        assert one.content_hash() == other.content_hash()


def test_a_recording_that_a_kill_has_cut_is_kept_readable_and_beside_the_new_one(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    killed_in(tmp_path, campaign, rig, "two")
    cut(tmp_path / "two.mcap", 0.7)
    run_campaign(campaign, rig, tmp_path, resume=True)
    assert len(read_recording(tmp_path / "two.mcap")) == round(1e3 * SHORT_S)
    assert 0 < len(read_recording(tmp_path / "two~1.mcap")) < round(1e3 * SHORT_S)


def test_where_an_attempt_cannot_be_kept_the_run_ends_and_nothing_is_lost(
    tmp_path: Path, rig: Rig, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    killed_in(tmp_path, campaign, rig, "two")
    recorded = (tmp_path / "two.mcap").read_bytes()
    replaced = Path.replace

    def fail(path: Path, target: Path) -> Path:
        if path.name == "two.mcap":
            raise OSError(errno.EIO, "Input/output error")
        return replaced(path, target)

    with monkeypatch.context() as failing:
        failing.setattr(Path, "replace", fail)
        with pytest.raises(OSError, match="Input/output error"):
            run_campaign(campaign, rig, tmp_path, resume=True)
    assert (tmp_path / "two.mcap").read_bytes() == recorded
    outcome = run_campaign(campaign, rig, tmp_path, resume=True)
    assert {test.status for test in outcome.tests} <= {Status.PASSED, Status.FAILED}
    assert (tmp_path / "two~1.mcap").read_bytes() == recorded


@pytest.mark.parametrize("journal", [None, b"", bytes(1000)], ids=["gone", "empty", "zeros"])
def test_a_run_whose_journal_says_nothing_is_not_begun_anew_over_its_results(
    tmp_path: Path, rig: Rig, campaign: Campaign, journal: bytes | None
) -> None:
    (tmp_path / "results.json").write_text("what was found")
    if journal is not None:
        (tmp_path / JOURNAL).write_bytes(journal)
    with pytest.raises(JournalError, match=r"while results\.json is there; put the journal"):
        run_campaign(campaign, rig, tmp_path, resume=True)
    assert (tmp_path / "results.json").read_text() == "what was found"


def test_a_run_that_is_going_on_is_not_resumed_beside_it_and_nothing_is_touched(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    with Journal(tmp_path) as journal:
        journal.write("begin")
        before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
        with pytest.raises(JournalError, match="a campaign is running in it"):
            run_campaign(campaign, rig, tmp_path, resume=True)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_campaign_that_has_ended_is_not_run_again(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    first = run_campaign(campaign, rig, tmp_path)
    observer = KillsAt()
    again = run_campaign(campaign, rig, tmp_path, observer=observer, resume=True)
    assert observer.begun == []
    assert [*map(record_of, again.tests)] == [*map(record_of, first.tests)]
    assert again.exit_code == first.exit_code


def test_a_test_that_was_stopped_is_run_again_and_its_recording_kept(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    stop = StopFlag()

    class Stopping(Observer):
        def test_advances(self, time_s: float, decision: Decision | None) -> None:
            if time_s > 2.0:
                stop.request("SIGINT")

    first = run_campaign(campaign, rig, tmp_path, observer=Stopping(), stop=stop)
    assert [test.status for test in first.tests] == [Status.ABORTED, *[Status.NOT_RUN] * 2]
    assert first.exit_code == 3
    second = run_campaign(campaign, rig, tmp_path, resume=True)
    assert Status.ABORTED not in {test.status for test in second.tests}
    (attempt,) = second.tests[0].attempts
    assert attempt.status is Status.ABORTED
    assert attempt.recording == "one~1.mcap"
    assert read_recording(tmp_path / "one~1.mcap").events[-1].kind == "abort"
    assert "stopped by SIGINT" in [each.what for each in second.history]


CHANGES: dict[str, Callable[[Campaign, Rig], tuple[Campaign, Rig]]] = {
    "campaign": lambda campaign, rig: (replace(campaign, false_alarms_per_day=2.0), rig),
    "rig": lambda campaign, rig: (campaign, replace(rig, gain_V_per_m=49.0)),
    "model": lambda campaign, rig: (
        replace(campaign, model=campaign.model.with_effect("entrained_air")),
        rig,
    ),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_has_changed_since_is_refused_and_nothing_touched(
    tmp_path: Path, rig: Rig, campaign: Campaign, what: str
) -> None:
    killed_in(tmp_path, campaign, rig, "two")
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    other = CHANGES[what](campaign, rig)
    with pytest.raises(JournalError, match=f"{what}.* changed since the run began"):
        run_campaign(*other, tmp_path, resume=True)
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_another_campaign_s_run_is_not_resumed(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    run_campaign(campaign, rig, tmp_path)
    with pytest.raises(JournalError, match="holds a run of the campaign bench campaign, not of"):
        run_campaign(replace(campaign, name="another"), rig, tmp_path, resume=True)


@pytest.mark.parametrize(
    ("kind", "details"),
    [
        ("begin", {"tests": ["one"], "started": "never"}),
        ("phase", {"test": "a", "phase": "setup"}),
        ("phase", {"test": 1, "phase": "setup"}),
        ("outcome", {"test": -1}),
    ],
)
def test_an_entry_of_no_time_or_of_no_test_of_the_campaign_is_no_journal_s(
    kind: str, details: dict[str, Any]
) -> None:
    state = JournalState(tests=("one",))
    with pytest.raises(ValueError, match=r"isoformat|the test .* of 1"):
        state.take(Entry(0, "2026-11-27T10:00:00+00:00", kind, details))


def test_where_nothing_was_begun_a_resumed_campaign_begins(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    (tmp_path / JOURNAL).write_bytes(b'{"n": 0, "at": "2026-')
    outcome = run_campaign(campaign, rig, tmp_path, resume=True)
    assert Status.NOT_RUN not in {test.status for test in outcome.tests}


def test_thresholds_learnt_before_a_kill_hold_after_it(
    tmp_path: Path, rig: Rig, make_test: MakeTest, leaking: MakeTest, make_campaign: MakeCampaign
) -> None:
    tests = (make_test(duration_s=20.0), leaking(duration_s=20.0))
    campaign = make_campaign(*tests, filter_name="thesis-6")
    whole = run_campaign(campaign, rig, tmp_path / "whole")
    killed_in(tmp_path / "cut", campaign, rig, "external_leakage_1")
    resumed = run_campaign(campaign, rig, tmp_path / "cut", resume=True)
    assert resumed.tests[1].thresholds_from == "healthy tests: healthy"
    assert resumed.tests[1].decision == whole.tests[1].decision


def test_every_phase_of_a_test_is_in_the_journal_in_order(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    run_campaign(campaign, rig, tmp_path)
    phases = [e["phase"] for e in read_journal(tmp_path / JOURNAL) if e.kind == "phase"]
    assert phases == ["setup", "positioning", "settle", "inject", "main", "cleanup"] * 3


def test_a_test_that_trips_on_purpose_is_finished_and_others_that_trip_are_not() -> None:
    def tripped(on_fault: OnFault, by_fault: bool | None = True) -> TestOutcome:
        return TestOutcome(
            "t", "healthy", Status.TRIPPED, 1, 5.0, on_fault=on_fault, fault_tripped=by_fault
        )

    assert tripped(OnFault.TRIP).is_finished
    assert not tripped(OnFault.HOLD).is_finished
    assert not tripped(OnFault.TRIP, by_fault=False).is_finished


def test_a_trip_in_the_journal_of_an_earlier_version_counts_as_it_did() -> None:
    outcome = TestOutcome("t", "healthy", Status.TRIPPED, 1, 5.0, on_fault=OnFault.TRIP)
    record = record_of(outcome)
    del record["fault_tripped"], record["limits_not_judged"]
    assert outcome_of(record).is_finished


def test_the_newest_unfinished_run_of_a_campaign_is_found(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    run_campaign(campaign, rig, tmp_path / "a")
    with pytest.raises(JournalError, match="holds no unfinished run of bench campaign"):
        unfinished_run(campaign.name, tmp_path)
    for name in ("b", "c"):
        killed_in(tmp_path / name, campaign, rig, "two")
    assert unfinished_run(campaign.name, tmp_path) == tmp_path / "c"


def test_a_journal_cut_at_any_line_tells_of_no_test_twice(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    run_campaign(campaign, rig, tmp_path)
    entries = read_journal(tmp_path / JOURNAL)
    finished: list[set[int]] = []
    for count in range(1, len(entries) + 1):
        standing = standing_of(entries[:count])
        finished.append(set(standing.finished))
        assert not standing.attempts
    assert finished[-1] == {0, 1, 2}
    assert all(one <= next_ for one, next_ in pairwise(finished))
