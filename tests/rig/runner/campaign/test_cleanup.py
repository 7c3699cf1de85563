"""Cleaning up runs whatever a test ended by, and in bounded time; the clock is a fake one."""

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from faults.campaign import Campaign, CampaignTest
from rig.configuration.rigs.rig import Rig
from rig.runner import CampaignOutcome, Status, run_campaign
from rig.runner.campaign.operator_requests import Desk
from rig.runner.campaign.simulated_bench import SimulatedBench, SimulatedTest
from rig.runner.run_folder.journal import JOURNAL, read_journal

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class FakeClock:
    """A clock that stands still unless it is moved, and the timers that run by it."""

    def __init__(self) -> None:
        self.now = 0.0
        self.timers: list[FakeTimer] = []

    def advance(self, seconds: float) -> None:
        self.now += seconds
        for timer in [each for each in self.timers if each.due <= self.now]:
            self.timers.remove(timer)
            timer.call()


class FakeTimer:
    """What `threading.Timer` is to a test."""

    clock: FakeClock
    ident: int | None = None

    def __init__(self, seconds: float, call: Callable[[], None]) -> None:
        self.daemon = False
        self.call = call
        self.seconds = seconds

    def start(self) -> None:
        assert self.ident is None
        self.ident = 1
        self.due = self.clock.now + self.seconds
        self.clock.timers.append(self)

    def cancel(self) -> None:
        if self in self.clock.timers:
            self.clock.timers.remove(self)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> FakeClock:
    FakeTimer.clock = FakeClock()
    monkeypatch.setattr("rig.runner.campaign.campaign_test_run.threading.Timer", FakeTimer)
    return FakeTimer.clock


@pytest.fixture
def campaign(make_test: MakeTest, make_campaign: MakeCampaign) -> Campaign:
    return make_campaign(*(make_test(name, duration_s=5.0) for name in ("one", "two")))


# It has two parts, one after the recording's end and one at the test's: the time of both counts.
@pytest.mark.parametrize(
    ("taken_s", "overdue"),
    [
        ((59.9,), False),
        ((60.0,), True),
        ((600.0,), True),
        ((30.0, 29.0), False),
        ((30.0, 31.0), True),
    ],
)
def test_a_cleanup_that_hangs_is_ended_and_reported_once(
    tmp_path: Path,
    rig: Rig,
    campaign: Campaign,
    clock: FakeClock,
    monkeypatch: pytest.MonkeyPatch,
    taken_s: tuple[float, ...],
    overdue: bool,
) -> None:
    safe_state = SimulatedTest.safe_state
    ended: list[float] = []
    left = list(taken_s)

    def hangs(test: SimulatedTest) -> None:
        if left:
            clock.advance(left.pop(0))
        safe_state(test)

    monkeypatch.setattr(SimulatedTest, "safe_state", hangs)
    outcome = run_campaign(
        campaign, rig, tmp_path, overdue=lambda: ended.append(clock.now)
    )  # a program ends here; this one goes on, to be looked at
    kinds = [entry.kind for entry in read_journal(tmp_path / JOURNAL)]
    assert kinds.count("overdue") == len(ended) == (1 if overdue else 0)
    told = [each.what for each in outcome.history]
    assert told == (["cleaning up after one took too long; ended at once"] if overdue else [])
    assert not clock.timers


def ran_with_a_crash(
    tmp_path: Path,
    rig: Rig,
    campaign: Campaign,
    monkeypatch: pytest.MonkeyPatch,
    method: str,
) -> tuple[CampaignOutcome, list[str]]:
    """Run a campaign whose first test crashes in a method; return also who was made safe."""
    safe: list[str] = []
    safe_state, original = SimulatedTest.safe_state, getattr(SimulatedTest, method)
    crashed: list[bool] = []

    def crashes(test: SimulatedTest, *arguments: Any) -> Any:
        if not crashed:
            crashed.append(True)
            raise RuntimeError("the field process hangs")
        return original(test, *arguments)

    def noted(test: SimulatedTest) -> None:
        safe.append("safe")
        safe_state(test)

    monkeypatch.setattr(SimulatedTest, method, crashes)
    monkeypatch.setattr(SimulatedTest, "safe_state", noted)
    return run_campaign(campaign, rig, tmp_path), safe


@pytest.mark.parametrize("method", ["position", "inject", "advance"])
def test_whatever_phase_a_test_dies_in_it_is_cleaned_up_after(
    tmp_path: Path, rig: Rig, campaign: Campaign, monkeypatch: pytest.MonkeyPatch, method: str
) -> None:
    outcome, safe = ran_with_a_crash(tmp_path, rig, campaign, monkeypatch, method)
    first, second = outcome.tests
    assert first.status is Status.ERROR
    assert second.recorded_s == 5.0
    assert safe
    entries = read_journal(tmp_path / JOURNAL)
    phases = [entry["phase"] for entry in entries if entry.kind == "phase" and entry["test"] == 0]
    assert phases[-1] == "cleanup"
    (ended,) = [n for n, entry in enumerate(entries) if entry["test"] == 0 and entry["outcome"]]
    assert entries[ended - 1]["phase"] == "cleanup"


@pytest.mark.parametrize("disk", ["full", "hangs"])
def test_a_cleanup_that_hangs_is_ended_though_the_journal_cannot_be_written(
    tmp_path: Path,
    rig: Rig,
    campaign: Campaign,
    clock: FakeClock,
    monkeypatch: pytest.MonkeyPatch,
    disk: str,
) -> None:
    record, safe_state = Desk.record, SimulatedTest.safe_state
    ended: list[float] = []
    reported: list[str] = []
    disk_is_back = threading.Event()

    def not_written(desk: Desk, kind: str, **told: Any) -> None:
        if kind == "overdue" and disk == "full":
            raise OSError("no space left")
        if kind == "overdue":
            disk_is_back.wait()
        record(desk, kind, **told)

    def hangs(test: SimulatedTest) -> None:
        if not ended:
            clock.advance(61.0)
        safe_state(test)

    monkeypatch.setattr("rig.runner.campaign.setting.TELLING_S", 0.1)
    monkeypatch.setattr(Desk, "record", not_written)
    monkeypatch.setattr(SimulatedTest, "safe_state", hangs)
    monkeypatch.setattr(SimulatedBench, "is_overdue", lambda bench: reported.append("overdue"))
    run_campaign(campaign, rig, tmp_path, overdue=lambda: ended.append(clock.now))
    disk_is_back.set()
    assert ended == [61.0]
    assert reported == ["overdue"]
