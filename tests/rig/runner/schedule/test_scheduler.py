"""A night's schedule, compressed by a fake clock: order, retries, missed runs, halts, restarts."""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import Phase, given, settings, strategies as st

from rig.configuration.campaigns.schedule import MOST_TIMES, Entry, Missed, Schedule
from rig.runner.run_folder.journal import Journal, JournalError, read_journal
from rig.runner.schedule.additions import ADDITIONS, add
from rig.runner.schedule.scheduler import (
    JOURNAL,
    MOST_RESUMES,
    Job,
    Scheduler,
    ScheduleState,
    state_of,
)

EVENING = datetime(2026, 11, 21, 20, 0, tzinfo=UTC)
NIGHT = timedelta(hours=12)


class Crash(BaseException):
    """Stands for a kill of the scheduler."""


class FakeHands:
    """A clock that runs as it is slept by, and runs that take their time on it."""

    def __init__(self, at: datetime = EVENING) -> None:
        self.at = at
        self.minutes: dict[str, float] = {}
        self.codes: dict[str, list[int]] = {}
        self.ran: list[tuple[str, str]] = []
        self.folders: list[str] = []
        self.followed: list[tuple[str, int]] = []
        self.said: list[str] = []
        self.crash_in = ""
        self.problem = ""
        self.busy_until = {"": EVENING}

    def now(self) -> datetime:
        return self.at

    def sleep(self, seconds: float) -> None:
        # Fractions of a second would make a night long.
        self.at += timedelta(seconds=max(seconds, 1.0))

    def run(self, job: Job, entry: Entry | None) -> int:
        assert job.folder is not None
        self.ran.append((f"{self.at:%H:%M}", job.entry))
        self.folders.append(job.folder)
        if self.crash_in == job.entry:
            self.crash_in = ""
            raise Crash
        self.at += timedelta(minutes=self.minutes.get(job.entry, 10.0))
        codes = self.codes.get(job.entry, [])
        return codes.pop(0) if codes else 0

    def busy(self, job: Job) -> str:
        until = self.busy_until.get(job.entry, EVENING)
        return "daq is in use by the process 7" if self.at < until else ""

    def after(self, job: Job, exit_code: int) -> str:
        self.followed.append((job.entry, exit_code))
        return self.problem

    def say(self, text: str) -> None:
        self.said.append(text)


@pytest.fixture(scope="module", autouse=True)
def looks_seldom() -> Iterator[None]:
    """Let the scheduler look for requests every five minutes, so that a night has few looks."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("rig.runner.schedule.scheduler.POLL_S", 300.0)
        yield


@pytest.fixture
def schedule(tmp_path: Path) -> Schedule:
    entries = (
        Entry("leaks", "quickstart", cron="0 22 * * *"),
        Entry("friction", "friction_3_1", cron="0 22 * * *"),
        Entry("hourly", "quickstart", every_s=4 * 3600.0, start=EVENING + timedelta(hours=1)),
    )
    path = tmp_path / "night.yaml"
    return Schedule("night", path, tmp_path, ZoneInfo("UTC"), entries)


def night(schedule: Schedule, hands: FakeHands, until: datetime = EVENING + NIGHT) -> ScheduleState:
    """Run a schedule from the hands' present to a time."""
    with Journal(schedule.folder, resume=True, name=JOURNAL, now=hands.now) as journal:
        scheduler = Scheduler(schedule, journal, hands)
        scheduler.run(lambda: hands.at >= until)
        return scheduler.state


def test_runs_begin_at_their_times_one_after_another_in_the_order_of_the_file(
    schedule: Schedule,
) -> None:
    hands = FakeHands()
    state = night(schedule, hands)
    assert hands.ran == [
        ("21:00", "hourly"), ("22:00", "leaks"), ("22:10", "friction"), ("01:00", "hourly"),
        ("05:00", "hourly"),
    ]  # fmt: skip
    assert [ended.exit_code for ended in state.history] == [0] * 5
    assert hands.followed == [(name, 0) for _, name in hands.ran]
    assert len(set(hands.folders)) == 5
    assert not state.missed


def only(schedule: Schedule, **changes: object) -> Schedule:
    """Keep the hourly entry, changed."""
    entry = replace(schedule.entries[2], **changes)  # type: ignore[arg-type]
    return replace(schedule, entries=(entry,))


def test_a_run_that_fails_is_retried_as_often_as_told_into_folders_of_its_own(
    schedule: Schedule,
) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [1, 1, 1, 0]}
    retried = only(schedule, retries=2, retry_after_s=1800.0)
    state = night(retried, hands, EVENING + timedelta(hours=4))
    assert [time for time, _ in hands.ran] == ["21:00", "21:40", "22:20"]
    assert [ended.exit_code for ended in state.history] == [1, 1, 1]
    assert len(set(hands.folders)) == 3
    assert [ended.job.attempt for ended in state.history] == [1, 2, 3]


def test_bad_input_is_not_retried(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [2]}
    night(only(schedule, retries=2), hands, EVENING + timedelta(hours=4))
    assert len(hands.ran) == 1


@pytest.mark.parametrize(
    ("policy", "runs", "missed"), [("skip", 0, 6), ("run_once", 1, 5), ("run_all", 6, 0)]
)
def test_times_that_were_missed_are_handled_by_the_stated_policy(
    schedule: Schedule, policy: str, runs: int, missed: int
) -> None:
    away = only(schedule, missed=Missed(policy))
    night(away, FakeHands(), EVENING + timedelta(minutes=30))
    # 21:00, then every four hours to 17:00: six times.
    hands = FakeHands(EVENING + timedelta(hours=23))
    state = night(away, hands, EVENING + timedelta(hours=24, minutes=30))
    assert len(hands.ran) == runs
    assert state.missed.get("hourly", 0) == missed


def test_a_busy_rig_is_waited_for_and_lets_runs_on_other_rigs_pass(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.busy_until = {"leaks": EVENING + timedelta(hours=3)}
    state = night(schedule, hands, EVENING + timedelta(hours=4))
    assert hands.ran == [("21:00", "hourly"), ("22:00", "friction"), ("23:00", "leaks")]
    assert [ended.exit_code for ended in state.history] == [0, 0, 0]
    assert hands.said.count("leaks: waits for its rig: daq is in use by the process 7") == 1
    assert not state.busy


def test_a_rig_that_stays_busy_is_given_up_after_the_time_that_is_set_and_the_run_retried(
    schedule: Schedule,
) -> None:
    hands = FakeHands()
    hands.busy_until = {"hourly": EVENING + timedelta(hours=2.4)}
    waits = only(schedule, wait_for_rig_s=3600.0, retries=1, retry_after_s=1800.0)
    state = night(waits, hands, EVENING + timedelta(hours=4))
    assert [(ended.exit_code, ended.job.folder is None) for ended in state.history] == [
        (2, True), (0, False),
    ]  # fmt: skip
    assert hands.ran == [("22:30", "hourly")]
    assert hands.followed == [("hourly", 2), ("hourly", 0)]


def test_a_run_that_another_program_was_faster_than_waits_and_is_not_lost(
    schedule: Schedule,
) -> None:
    class Faster(FakeHands):
        def run(self, job: Job, entry: Entry | None) -> int:
            if not self.ran:
                self.busy_until = {"hourly": self.at + timedelta(hours=1)}
            return super().run(job, entry)

    hands = Faster()
    hands.codes, hands.minutes = {"hourly": [2, 0]}, {"hourly": 1.0}
    state = night(only(schedule), hands, EVENING + timedelta(hours=4))
    assert [ended.exit_code for ended in state.history] == [0]
    assert len(hands.ran) == 2
    assert len(set(hands.folders)) == 2


def test_what_was_due_just_now_is_not_missed(schedule: Schedule) -> None:
    skipping = only(schedule, missed=Missed.SKIP)
    night(skipping, FakeHands(), EVENING + timedelta(minutes=30))
    hands = FakeHands(EVENING + timedelta(hours=1, minutes=2))
    night(skipping, hands, EVENING + timedelta(hours=2))
    assert hands.ran == [("21:02", "hourly")]


def test_nothing_before_the_first_start_counts_as_missed(schedule: Schedule) -> None:
    hands = FakeHands(EVENING + timedelta(hours=1, minutes=30))
    state = night(only(schedule), hands, EVENING + timedelta(hours=2))
    assert not hands.ran
    assert not state.missed


def test_a_clock_that_was_years_ahead_and_is_set_back_stops_no_schedule(schedule: Schedule) -> None:
    failing = only(schedule, retries=1, retry_after_s=3600.0)
    ahead = FakeHands(EVENING + timedelta(days=3650))
    ahead.codes = {"hourly": [1]}
    night(failing, FakeHands(), EVENING)
    night(failing, ahead, ahead.at + timedelta(hours=1.5))
    assert [time for time, _ in ahead.ran] == ["21:00"]
    hands = FakeHands()
    state = night(failing, hands, EVENING + timedelta(hours=4))
    assert [time for time, _ in hands.ran] == ["21:00", "21:10"]
    assert [ended.job.attempt for ended in state.history] == [1, 1, 2]
    was = f"{EVENING + timedelta(days=3650, hours=1):%Y-%m-%d %H:%M}"
    assert hands.said[0] == f"the clock was set back from {was} UTC; times count from now on"


def test_times_that_come_while_the_rig_is_busy_wait_one_of_each_entry_at_most(
    schedule: Schedule,
) -> None:
    hands = FakeHands()
    hands.minutes = {"leaks": 9 * 60.0}
    state = night(schedule, hands, EVENING + timedelta(hours=14))
    # From 22:00 to 07:00; hourly was due at 01:00 and 05:00.
    assert hands.ran == [
        ("21:00", "hourly"), ("22:00", "leaks"), ("07:00", "friction"), ("07:10", "hourly"),
        ("09:00", "hourly"),
    ]  # fmt: skip
    assert state.missed == {"hourly": 1}


def test_after_a_crash_of_the_scheduler_the_run_that_was_begun_goes_on_in_its_folder(
    schedule: Schedule,
) -> None:
    hands = FakeHands()
    hands.crash_in = "leaks"
    with pytest.raises(Crash):
        night(schedule, hands)
    back = FakeHands(hands.at + timedelta(minutes=30))
    state = night(schedule, back)
    assert back.ran[:2] == [("22:30", "leaks"), ("22:40", "friction")]
    assert back.folders[0] == hands.folders[-1]
    ended = [each.job.entry for each in state.history]
    assert ended == ["hourly", "leaks", "friction", "hourly", "hourly"]


@settings(max_examples=15, phases=[Phase.generate])
@given(cut=st.integers(0, 10_000))
def test_cut_at_any_byte_the_journal_loses_and_repeats_no_run_that_ended(cut: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        entry = Entry("hourly", "quickstart", every_s=3600.0, missed=Missed.RUN_ALL)
        path = Path(folder)
        plan = Schedule("night", path / "s.yaml", path, ZoneInfo("UTC"), (entry,))
        first = FakeHands()
        night(plan, first, EVENING + timedelta(hours=6))
        content = (path / JOURNAL).read_bytes()
        begin = content.index(b"\n") + 1
        (path / JOURNAL).write_bytes(content[: begin + cut % (len(content) - begin + 1)])
        with Journal(path, resume=True, name=JOURNAL) as journal:
            known = Scheduler(plan, journal, FakeHands()).state
        ended = {each.job.id for each in known.history}
        second = FakeHands(EVENING + timedelta(hours=6))
        state = night(plan, second, EVENING + timedelta(hours=12))
        ids = [each.job.id for each in state.history]
        assert len(ids) == len(set(ids))
        assert ended <= set(ids)
        due = {f"hourly@{(EVENING + timedelta(hours=n)).isoformat()}" for n in range(1, 11)}
        assert due <= set(ids)


def test_a_run_that_was_killed_goes_on_but_not_for_ever(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [-9, 0]}
    state = night(only(schedule), hands, EVENING + timedelta(hours=3))
    assert len(hands.ran) == 2
    assert len(set(hands.folders)) == 1
    assert [ended.exit_code for ended in state.history] == [0]
    hands.codes = {"hourly": [-9] * 100}
    state = night(only(schedule), hands, EVENING + timedelta(hours=6))
    assert len(hands.ran) == 2 + MOST_RESUMES + 1
    assert state.halted


def test_a_trip_halts_the_schedule_until_somebody_has_looked(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [3]}
    state = night(schedule, hands)
    assert hands.ran == [("21:00", "hourly")]
    assert "tripped or was stopped (exit code 3)" in state.halted
    assert [job.entry for job in state.queue] == ["leaks", "friction", "hourly"]
    add(schedule.folder, resume=True)
    state = night(schedule, hands, hands.at + timedelta(hours=1))
    assert not state.halted
    assert [name for _, name in hands.ran[1:4]] == ["leaks", "friction", "hourly"]


def test_the_journal_names_who_added_a_run_and_who_went_on(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [3]}
    add(schedule.folder, campaign="loaded_7_2", name="extra", by=" Bo\n")
    night(schedule, hands)
    add(schedule.folder, resume=True, by="Eva")
    night(schedule, hands, hands.at + timedelta(hours=1))
    entries = read_journal(schedule.folder / JOURNAL)
    named = {entry.kind: entry["by"] for entry in entries if entry.kind in ("added", "resumed")}
    assert named == {"added": "Bo", "resumed": "Eva"}


def test_a_schedule_may_go_on_after_a_trip(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [3]}
    night(replace(schedule, halt=False), hands)
    assert len(hands.ran) == 5


def test_a_stop_of_the_scheduler_is_no_stop_of_the_rig(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.codes = {"hourly": [3]}
    stop_at = EVENING + timedelta(hours=1, minutes=5)
    state = night(only(schedule), hands, stop_at)
    assert not state.halted
    assert state.present is not None
    night(only(schedule), hands, stop_at + timedelta(hours=1))
    assert hands.folders[0] == hands.folders[1]


def test_what_is_added_runs_next_and_once(schedule: Schedule) -> None:
    hands = FakeHands()
    add(schedule.folder, campaign="validation_3_2", name="extra")
    with (schedule.folder / ADDITIONS).open("ab") as file:
        file.write(b'{"id": "half')
    add(schedule.folder, campaign="loaded_7_2", name="another")
    with (schedule.folder / ADDITIONS).open("ab") as file:
        file.write(b'[1]\n{"id": 7}\n' + b"[" * 70_000 + b"\n")
    night(schedule, hands, EVENING + timedelta(minutes=40))
    night(schedule, hands, EVENING + timedelta(minutes=50))
    assert [name for _, name in hands.ran] == ["extra", "another"]


@pytest.mark.parametrize("name", ["../outside", "/etc/outside", "..", "a/../../b", "..\\x", "-rf"])
def test_whatever_a_job_is_called_its_folder_is_one_of_the_schedule_s(
    schedule: Schedule, name: str
) -> None:
    hands = FakeHands()
    add(schedule.folder, campaign="quickstart", name=name)
    add(schedule.folder, campaign=f"{name}/x.yaml")
    night(only(schedule, name=name), hands, EVENING + timedelta(hours=2))
    assert len(hands.folders) == 3
    for folder in map(Path, hands.folders):
        assert folder.resolve().parent == schedule.folder.resolve()
        assert not folder.name.startswith((".", "-"))


def test_a_hook_that_fails_ends_nothing_and_is_in_the_journal(schedule: Schedule) -> None:
    hands = FakeHands()
    hands.problem = "hook notify: exit code 1"
    night(schedule, hands)
    assert len(hands.ran) == 5
    assert b"hook notify: exit code 1" in (schedule.folder / JOURNAL).read_bytes()


@pytest.mark.parametrize(
    ("kind", "details"),
    [
        ("collected", {"upto": 7}),
        ("collected", {"upto": "2026-11-21T20:00:00"}),
        ("collected", {"upto": EVENING.isoformat(), "due": 7}),
        ("added", {"id": "a", "entry": "a", "campaign": "c", "rig": 7, "due": EVENING.isoformat()}),
        ("busy", {"id": "a"}),
    ],
)
def test_a_journal_of_wrong_types_is_refused_by_its_line(
    tmp_path: Path, kind: str, details: dict[str, Any]
) -> None:
    with Journal(tmp_path, name=JOURNAL) as written:
        written.write(kind, **details)
    with pytest.raises(JournalError, match=rf"{JOURNAL}:1: is no entry of a schedule"):
        state_of(read_journal(tmp_path / JOURNAL))


def test_two_schedulers_cannot_run_the_same_schedule(schedule: Schedule) -> None:
    busy = "the schedule is running"
    with (
        Journal(schedule.folder, resume=True, name=JOURNAL),
        pytest.raises(JournalError, match=busy),
        Journal(schedule.folder, resume=True, name=JOURNAL, busy=busy),
    ):
        pass


# -- times -----------------------------------------------------------------------------------------

Times = Callable[[Entry, datetime, datetime], list[datetime]]


def test_cron_times_are_those_of_the_schedule_s_time_zone_over_the_change_of_summer_time(
    schedule: Schedule,
) -> None:
    helsinki = replace(schedule, zone=ZoneInfo("Europe/Helsinki"))
    entry = Entry("noon", "quickstart", cron="0 12 * * *")
    days = (datetime(2026, 10, 24, tzinfo=UTC), datetime(2026, 10, 27, tzinfo=UTC))
    assert [f"{time:%d %H:%M}" for time in helsinki.times(entry, *days)] == [
        "24 09:00", "25 10:00", "26 10:00",
    ]  # fmt: skip


@given(
    minutes=st.integers(1, 5000),
    after=st.integers(-10_000, 10_000),
    span=st.integers(0, 20_000),
)
def test_interval_times_are_on_the_grid_and_none_is_left_out(
    minutes: int, after: int, span: int
) -> None:
    start = datetime(2026, 1, 1, tzinfo=UTC)
    plan = Schedule("s", Path("s"), Path("s"), ZoneInfo("UTC"), ())
    entry = Entry("e", "c", every_s=60.0 * minutes, start=start)
    begin = start + timedelta(minutes=after)
    times = plan.times(entry, begin, begin + timedelta(minutes=span))
    grid = [n * minutes for n in range(-1, 40_000 // minutes + 2)]
    wanted = [n for n in grid if n >= 0 and after < n <= after + span]
    found = [round((time - start).total_seconds() / 60.0) for time in times]
    assert found == wanted[-MOST_TIMES:]


def test_a_single_time_comes_once(schedule: Schedule) -> None:
    at = EVENING + timedelta(hours=1)
    entry = Entry("once", "quickstart", at=at)
    assert schedule.times(entry, EVENING, EVENING + NIGHT) == [at]
    assert schedule.times(entry, at, EVENING + NIGHT) == []
    assert schedule.next_time(entry, at) is None


def test_a_schedule_that_slept_for_years_keeps_the_newest_times(schedule: Schedule) -> None:
    entry = Entry("often", "quickstart", every_s=60.0)
    times = schedule.times(entry, EVENING - timedelta(days=30), EVENING)
    assert len(times) == MOST_TIMES
    assert times[-1] == EVENING
