"""Plays one drawn case, and gathers what devices, files and processes tell of it."""

import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from signal import SIGCONT
from typing import Any, Final

from rig.runner.run_folder.journal import JOURNAL, JournalError, read_journal
from tools.chaos.judge import cause_of, lost_s, readable
from tools.chaos.stage import FIRST_FAULT, TEST, NotBegunError, Stage

from .bounds import END_S, LEFT_S
from .fault import Case, Strike, Struck
from .pauses import HostPauses
from .strikes import NotTakenError

TESTS: Final = (
    {
        "name": "leaks",
        # The longest claim of a drawn fault, 5.2 s of the recorder, ends within the test.
        "duration": "11 s",
        "settle": "0.1 s",
        "setpoint": TEST["setpoint"],
        "faults": [{**FIRST_FAULT, "at": "0.1 s"}],
    },
)
STAGES: Final = 3
"""How often a case is set up: on a machine that stalls, the rig may trip before its test."""
SAFE_S: Final = 20.0
"""For how long it is waited until the devices are safe, s; what is later is found in the record."""


@dataclass(frozen=True)
class Evidence:
    """What a case left behind. Times are CLOCK_MONOTONIC in ns.

    Attributes:
        struck: the faults that were struck before the run had ended, and came to where they strike.
        events: the emulator's record.
        pauses: begin and end of each pause of the host.
        exit_code: exit code of the run; None if it did not end.
        alive: parts that had not ended.
        cause: first-out cause, or why the run was stopped; empty if it came to its end.
        results: what results.json says; None if there is none that can be read.
        confirmed: devices whose safe state the trip report calls confirmed.
        trip_reports: number of trip reports.
        journal_problem: why the journal cannot be read; empty if it can.
        lost_s: how much of the recording before the first strike is missing, s; None if no row of
            it can be read or found.
        printed: what the run printed, and the log of its processes.
        unfinished: names of the files that were left half written.
    """

    struck: tuple[Struck, ...]
    events: tuple[dict[str, Any], ...] = ()
    pauses: list[tuple[int, int]] = field(default_factory=list)
    exit_code: int | None = 0
    alive: tuple[str, ...] = ()
    cause: str = ""
    results: dict[str, Any] | None = None
    confirmed: frozenset[str] = frozenset()
    trip_reports: int = 0
    journal_problem: str = ""
    lost_s: float | None = 0.0
    printed: str = ""
    unfinished: tuple[str, ...] = ()


def play(case: Case, folder: Path) -> Evidence:
    """Play a case in an empty folder; return what it left behind.

    If the run ends before its test, the case is set up again, up to `STAGES` times in all.

    Raises:
        StageError: the emulator did not start or refused a fault, or the test never began.
    """
    for number in range(1, STAGES + 1):
        place = folder / str(number)
        place.mkdir()
        try:
            return _played(case, place)
        except NotBegunError:
            if number == STAGES:
                raise
    raise AssertionError("no stage was set up")


def _played(case: Case, folder: Path) -> Evidence:
    plain = not case.with_plots
    with Stage(folder, tests=TESTS, plain_report=plain) as stage, HostPauses() as pauses:
        stage.begin()
        began_s = time.monotonic()
        struck = [found for each in case.strikes if (found := strike(stage, each, began_s))]
        _wait(lambda: stage.run.poll() is not None or stage.is_safe(), SAFE_S)
        for found in struck:
            _go_on(stage, found)
        _wait(lambda: stage.run.poll() is not None, 1e-3 * END_S.ms)
        exit_code = stage.run.poll()
        _wait(lambda: not stage.living(), 1e-3 * LEFT_S.ms)
        alive = tuple(stage.living())
        _wait(stage.is_safe, SAFE_S)
    return _evidence(stage, tuple(struck), pauses.found, exit_code, alive)


def strike(stage: Stage, strike: Strike, began_s: float) -> Struck | None:
    """Wait for a strike's moment and strike.

    Returns:
        None if the run or the part had ended, or the other fault kept the strike from its device.
    """
    time.sleep(max(began_s + strike.at_s - time.monotonic(), 0.0))
    if stage.run.poll() is not None:
        return None
    begun_ns = time.monotonic_ns()
    try:
        for step in strike.fault.steps:
            step(stage)
    except (ProcessLookupError, NotTakenError):
        return None
    # The last step notes its own moment, unless it is one that lets a stopped part go on.
    return Struck(strike.fault, max(begun_ns, stage.injected_ns), time.monotonic_ns())


def _go_on(stage: Stage, struck: Struck) -> None:
    for part in struck.fault.stops:
        try:
            stage.send(SIGCONT, part)
        except ProcessLookupError:
            continue


def _wait(done: Any, patience_s: float) -> None:
    """Wait until `done()` or a time, s, is over; what is late shows in the evidence."""
    until_s = time.monotonic() + patience_s
    while time.monotonic() < until_s and not done():
        time.sleep(0.02)


def _evidence(
    stage: Stage,
    struck: tuple[Struck, ...],
    pauses: list[tuple[int, int]],
    exit_code: int | None,
    alive: tuple[str, ...],
) -> Evidence:
    kept = stage.out.with_name(f"{stage.out.name}-kept")
    out = kept if kept.exists() else stage.out
    recording = readable(out / "leaks.mcap", stage.folder / "recovered.mcap")
    report, log = out / "trip-1.json", out / "session.log"
    confirmations = json.loads(report.read_text())["confirmations"] if report.exists() else ()
    first_ns = min((each.at_ns for each in struck), default=0)
    return Evidence(
        struck,
        tuple(json.loads(line) for line in stage.record.read_text().splitlines()),
        pauses,
        exit_code,
        alive,
        cause_of(out, recording, stage.printed),
        _results(out),
        frozenset(each["what"].split()[0] for each in confirmations if each["after_s"] is not None),
        len(list(out.glob("trip-*.json"))),
        _journal_problem(out),
        None if recording is None else lost_s(stage.trace, first_ns, recording),
        stage.printed + (log.read_text() if log.exists() else ""),
        tuple(path.name for path in out.glob(".*.partial")),
    )


def _results(out: Path) -> dict[str, Any] | None:
    try:
        found: dict[str, Any] = json.loads((out / "results.json").read_text())
    except (OSError, ValueError):
        return None
    return found


def _journal_problem(out: Path) -> str:
    try:
        read_journal(out / JOURNAL)
    except JournalError as error:
        return str(error)
    return ""
