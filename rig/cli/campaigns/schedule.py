"""`rig schedule` runs campaigns at their times, in the foreground or under systemd."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import click

from rig.cli.option_types import text
from rig.configuration import ConfigError, Entry, Rig, Schedule, load_campaign, load_schedule
from rig.control_socket import own_name
from rig.recording import replace_text
from rig.runner.campaign import StopFlag, stop_on_signals
from rig.runner.run_folder import Journal, RunError, is_written, read_journal, read_run, runs_below
from rig.runner.schedule import (
    JOURNAL,
    Job,
    Scheduler,
    ScheduleState,
    add as add_request,
    run_hook,
    state_of,
    waiting,
)

_POLL_S = 0.5
_SHOWN = 20

_path = click.argument("schedule", type=click.Path(path_type=Path), metavar="SCHEDULE.yaml")
_by = click.option(
    "--by", default="", type=text, metavar="NAME",
    help="Who asks, for the schedule's journal; your user's name if not given.",
)  # fmt: skip


@click.group()
def command() -> None:
    """Run campaigns at times or intervals, one after another.

    The schedule's folder (`runs` in its file) holds the runs, a journal by which the schedule goes
    on after a crash, and trend.html, a page on all runs (docs/schedules.md).
    """


@command.command()
@_path
@click.option("--until-idle", is_flag=True, help="End once nothing waits, instead of waiting on.")
def run(schedule: Path, until_idle: bool) -> int:
    """Run the schedule in the foreground, as a service does too.

    SIGINT and SIGTERM end the run that is under way; the next start of the schedule resumes it.
    """
    loaded = load_schedule(schedule)
    stop = StopFlag()
    try:
        loaded.folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RunError(f"{loaded.folder}: cannot be made: {error.strerror}") from None
    busy = f"{loaded.folder}: the schedule is running; end it first, or give another `runs`"
    journal = Journal(loaded.folder, resume=True, name=JOURNAL, busy=busy)
    with stop_on_signals(stop), journal:
        hands = _Hands(loaded, stop)
        scheduler = Scheduler(loaded, journal, hands)
        hands.say(f"{loaded.name}: {len(loaded.entries)} entries, runs in {loaded.folder}")
        if scheduler.state.halted:
            hands.say(f"halted: {scheduler.state.halted}; rig schedule resume {schedule}")
        scheduler.run(lambda: stop.requested, until_idle=until_idle)
    return 0


@command.command()
@_path
@click.argument("campaign")
@click.option("--rig", metavar="RIG", help="Run on this rig, not the campaign's.")
@click.option("--name", help="Name of the entry; the campaign's if not given.")
@_by
def add(schedule: Path, campaign: str, rig: str | None, name: str | None, by: str) -> int:
    """Have CAMPAIGN run once, as soon as the schedule comes to it."""
    loaded = load_schedule(schedule)
    checked, _ = load_campaign(campaign, rig)
    on_rig = None if rig is None else _absolute(rig)
    entry = name or checked.name
    _ask(loaded, by, name=entry, campaign=_absolute(campaign), rig=on_rig)
    click.echo(f"{checked.name}: waits in {loaded.folder}")
    return 0


@command.command()
@_path
@_by
def resume(schedule: Path, by: str) -> int:
    """Go on with a schedule that halted as a run tripped or was stopped; look at the rig first."""
    loaded = load_schedule(schedule)
    state = _state(loaded)
    if not state.halted:
        raise RunError(f"{schedule}: is not halted")
    _ask(loaded, by, resume=True)
    click.echo(f"goes on; it was halted as {state.halted}")
    return 0


@command.command("list")
@_path
@click.option("--json", "as_json", is_flag=True, help="As one JSON object.")
def list_entries(schedule: Path, as_json: bool) -> int:
    """Show the next time of every entry, the runs that wait, and the last runs that ended.

    Times are in the schedule's time zone; those of --json are UTC. It is also shown whether the
    schedule is running, and whether a run that was begun still goes on.
    """
    loaded = load_schedule(schedule)
    shown = _document(loaded, _state(loaded))
    if as_json:
        click.echo(json.dumps(shown, ensure_ascii=False))
        return 0
    for line in _lines(shown, loaded, schedule):
        click.echo(line)
    return 0


def _lines(shown: dict[str, Any], schedule: Schedule, path: Path) -> Iterator[str]:
    """Yield a schedule's document as lines for people, with times in the schedule's zone."""

    def when(time: str) -> str:
        return f"{datetime.fromisoformat(time).astimezone(schedule.zone):%F %T %Z}"

    if not shown["running"]:
        yield f"not running; rig schedule run {path}"
    if shown["halted"]:
        yield f"halted: {shown['halted']}; rig schedule resume {path}"
    for entry in shown["entries"]:
        missed = f"; missed {entry['missed']}" if entry["missed"] else ""
        next_ = when(entry["next"]) if entry["next"] else "never"
        yield f"{entry['name']}: next {next_}, {entry['campaign']}{missed}"
    present = shown["present"]
    if present:
        yield f"{present['state']}: {present['entry']} in {present['folder']}{_busy(present)}"
    for job in shown["queue"]:
        at = f"due {when(job['due'])}, attempt {job['attempt']}"
        yield f"waits: {job['entry']}, {at}{_busy(job)}"
    for added in shown["added"]:
        yield f"waits: {added['entry']}, added and not taken yet, {added['campaign']}"
    for ended in shown["history"]:
        # A run that was refused before anything moved has left no folder.
        is_kept = ended["folder"] and Path(ended["folder"]).is_dir()
        where = ended["folder"] if is_kept else "nothing was run"
        yield f"{when(ended['at'])} {ended['entry']}: exit code {ended['exit_code']}, {where}"


def _busy(job: dict[str, Any]) -> str:
    return f"; its rig is busy, {job['busy']}" if job["busy"] else ""


def _document(schedule: Schedule, state: ScheduleState) -> dict[str, Any]:
    now = datetime.now(UTC)
    is_running = is_written(schedule.folder, JOURNAL)
    present = None if state.present is None else _job(state.present, state)
    if present is not None:
        # The process of a run outlives a kill of the schedule.
        goes_on = is_running or is_written(Path(present["folder"]))
        present["state"] = "running" if goes_on else "interrupted"
    entries = [(entry, schedule.next_time(entry, now)) for entry in schedule.entries]
    return {
        "name": schedule.name,
        "runs": str(schedule.folder),
        "timezone": str(schedule.zone),
        "running": is_running,
        "halted": state.halted,
        "entries": [
            {
                "name": entry.name,
                "campaign": entry.campaign,
                "next": None if time is None else f"{time:%FT%TZ}",
                "missed": state.missed.get(entry.name, 0),
            }
            for entry, time in entries
        ],
        "present": present,
        "queue": [_job(job, state) for job in state.queue],
        "added": [
            {"entry": job.entry, "campaign": job.campaign}
            for job in waiting(schedule.folder, state, now)
        ],
        "history": [
            _job(ended.job, state) | {"exit_code": ended.exit_code, "at": f"{ended.at:%FT%TZ}"}
            for ended in state.history[-_SHOWN:]
        ],
    }


def _job(job: Job, state: ScheduleState) -> dict[str, Any]:
    busy = state.busy.get(job.id)
    return {
        "entry": job.entry,
        "due": f"{job.due:%FT%TZ}",
        "attempt": job.attempt,
        "folder": job.folder,
        "busy": "" if busy is None else busy.why,
    }


def _state(schedule: Schedule) -> ScheduleState:
    path = schedule.folder / JOURNAL
    return state_of(read_journal(path)) if path.exists() else ScheduleState()


def _ask(schedule: Schedule, by: str, **asked: Any) -> None:
    try:
        add_request(schedule.folder, by=by or own_name(), **asked)
    except OSError as error:
        raise RunError(f"{schedule.folder}: cannot be written: {error.strerror}") from None


def _absolute(reference: str) -> str:
    """Return the absolute path of a file; return the reference unchanged if it is no file."""
    return str(Path(reference).resolve()) if Path(reference).is_file() else reference


class _Hands:
    """The `Hands` of a schedule that really runs: with the clock, processes and the hook."""

    def __init__(self, schedule: Schedule, stop: StopFlag) -> None:
        self._schedule = schedule
        self._stop = stop
        self._rigs: dict[tuple[str, str | None], Rig] = {}

    def now(self) -> datetime:
        return datetime.now(UTC)

    def sleep(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until and not self._stop.requested:
            time.sleep(min(_POLL_S, max(0.0, until - time.monotonic())))

    def say(self, text: str) -> None:
        click.echo(f"{self.now():%FT%TZ} {text}")

    def run(self, job: Job, entry: Entry | None) -> int:
        """Run a campaign in a process of its own, wait for its end and return its exit code.

        A run in the same folder that is still going on is awaited first. Once a stop is requested,
        the process is told to end. A crash of that process does not end the schedule.
        """
        assert job.folder is not None
        folder = Path(job.folder)
        # The run of a scheduler that was killed goes on in its own process; wait until it ends.
        while is_written(folder) and not self._stop.requested:
            self.sleep(_POLL_S)
        arguments = ["run", job.campaign, "--out", job.folder, "--resume"]
        arguments += ["--rig", job.rig] if job.rig is not None else []
        arguments += [f"--by=schedule {self._schedule.name}"]
        stream = self._schedule.stream
        arguments += ["--stream", stream] if stream else []
        arguments += ["--pace", entry.pace] if entry is not None and entry.pace else []
        process = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", *arguments],
            stdin=subprocess.DEVNULL,
            cwd=self._schedule.path.parent,
        )
        while not self._stop.requested:
            with suppress(subprocess.TimeoutExpired):
                return process.wait(_POLL_S)
        # On Ctrl-C in a terminal the run has got the signal by itself already. To a process that
        # has ended meanwhile this does nothing.
        process.terminate()
        return process.wait()

    def busy(self, job: Job) -> str:
        if job.folder is not None and is_written(Path(job.folder)):
            return ""
        try:
            # Imported here, as what only lists a schedule does not need the supervisor's libraries.
            from rig.supervisor import why_busy

            return why_busy(self._rig_of(job))
        except ConfigError:
            # A file was changed since: the run itself tells what is wrong with it.
            return ""

    def _rig_of(self, job: Job) -> Rig:
        """Return the rig of a job by its files as they were when the job was first looked at."""
        key = job.campaign, job.rig
        if key not in self._rigs:
            _, self._rigs[key] = load_campaign(job.campaign, job.rig, self._schedule.path.parent)
        return self._rigs[key]

    def after(self, job: Job, exit_code: int) -> str:
        from rig.report.campaign import TREND, trend_page
        from rig.runner.run_folder import trends_of

        problems = []
        page = self._schedule.folder / TREND
        try:
            trends = trends_of(runs_below(self._schedule.folder))
            replace_text(page, trend_page(trends, self._schedule.name))
        except Exception as error:  # a page that cannot be made ends no schedule
            problems.append(f"no trend page: {type(error).__name__}: {error}")
        if self._schedule.hook:
            problems.append(run_hook(self._schedule.hook, self._places(job, exit_code, page)))
        return "; ".join(problem for problem in problems if problem)

    def _places(self, job: Job, exit_code: int, page: Path) -> dict[str, str]:
        folder = Path(job.folder or "")
        try:
            verdicts = ",".join(sorted(read_run(folder).verdicts))
        except RunError:
            verdicts = ""
        return {
            "schedule": self._schedule.name,
            "entry": job.entry,
            "campaign": job.campaign,
            "run": job.folder or "",
            "exit_code": str(exit_code),
            "verdicts": verdicts,
            "report": str(folder / "report.html") if job.folder else "",
            "trend": str(page),
        }
