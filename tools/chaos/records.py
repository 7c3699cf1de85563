"""Checks the folder of a run whose campaign was killed and resumed, any number of times."""

import html
import json
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rig.recording import RecordingError, read_recording, recover
from rig.recording.formats.mcap_reader import read_mcap
from rig.runner.campaign.setting import Phase
from rig.runner.outcomes.outcome_record import outcome_of
from rig.runner.run_folder.journal import JOURNAL, JournalError, read_journal
from rig.runner.run_folder.resuming import JournalState, standing_of

TICK_S = 1e-3


def finished_in(folder: Path) -> dict[int, Any]:
    """Return the outcomes of the finished tests, by index, from the journal of the run in `folder`.

    It is {} if the journal is missing or cannot be read.
    """
    try:
        entries = read_journal(folder / JOURNAL)
    except JournalError:
        return {}
    return {
        entry["test"]: entry["outcome"]
        for entry in entries
        if entry.kind == "outcome" and outcome_of(entry["outcome"]).is_finished
    }


def repeated(folder: Path) -> Iterator[str]:
    """Yield a message for each time that a test was begun again although it had finished.

    Raises:
        JournalError: the run in `folder` has no readable journal.
    """
    done: set[int] = set()
    for entry in read_journal(folder / JOURNAL):
        if entry.kind == "phase" and entry["phase"] == "setup" and entry["test"] in done:
            yield f"test {entry['test']} was run again"
        if entry.kind == "outcome" and outcome_of(entry["outcome"]).is_finished:
            done.add(entry["test"])


def record_problems(folder: Path, before: list[dict[int, Any]], tests: int) -> list[str]:
    """Return messages on what is wrong in the folder of a run that was killed, resumed and ended.

    Every test must be finished once, keep the outcome that it had at a kill, and have a readable
    recording of its full length to within 1 ms. The recording of an interrupted attempt must be
    there and readable, unless it was cut off before it held a sample. [] means nothing is wrong.

    Args:
        folder: folder of the run.
        before: what `finished_in` returned after each kill.
        tests: number of tests in the campaign.
    """
    found = list(repeated(folder))
    last = finished_in(folder)
    found += [f"test {index} was not finished" for index in range(tests) if index not in last]
    for kill, known in enumerate(before, 1):
        found += [
            f"test {index}, finished before kill {kill}, was lost or changed"
            for index, record in known.items()
            if last.get(index) != record
        ]
    results = json.loads((folder / "results.json").read_text())
    for test in results["tests"]:
        if test["recording"] is None:
            found.append(f"{test['name']}: no recording")
            continue
        try:
            # If a device did not answer, rows lack its readings; only the time is required.
            samples = len(read_recording(folder / test["recording"], required=("time_s",)))
        except RecordingError as error:
            found.append(f"{test['name']}: {error}")
            continue
        if abs(samples * TICK_S - test["duration_s"]) > TICK_S:
            found.append(f"{test['name']}: {samples} samples of {test['duration_s']:g} s")
    state = standing_of(read_journal(folder / JOURNAL))
    kept = [each for attempts in state.attempts.values() for each in attempts]
    for attempt in kept:
        if attempt.recording is None:
            continue
        try:
            read_mcap(str(folder / attempt.recording))
        except RecordingError as error:
            if _has_samples(folder / attempt.recording):
                found.append(f"{attempt.recording}, of an attempt: {error}")
    return found


def _has_samples(path: Path) -> bool:
    """Return whether samples can be recovered from a recording; True also if it is missing.

    A recording that had hardly begun when it was cut off holds no samples yet.
    """
    with TemporaryDirectory() as folder:
        try:
            recover(path, Path(folder) / "recovered.mcap")
        except RecordingError:
            return not path.exists()
    return True


def told_problems(folder: Path, killed: Sequence[str]) -> list[str]:
    """Return messages on what results and report leave out or say wrongly about a run's kills.

    The results must have one entry on resuming for each kill, in order, which names its test and
    phase. The report must have each entry of the results' history, and each attempt's message.

    Args:
        folder: folder of the run, which was resumed to its end.
        killed: test and phase at each kill (`JournalState.where`); "" for a kill between two tests.
    """
    results = json.loads((folder / "results.json").read_text())
    page = html.unescape((folder / "report.html").read_text())
    events = [each["what"] for each in results["history"]]
    resumed = [what for what in events if what.startswith("resumed")]
    found = []
    wanted = [f"resumed after a kill in {each}" if each else "resumed" for each in killed]
    if resumed != wanted:
        found.append(f"the results tell {resumed}, not {wanted}")
    found += [f"the report does not tell: {what}" for what in events if what not in page]
    for test in results["tests"]:
        for attempt in test["attempts"]:
            if attempt["message"] not in page:
                found.append(f"the report does not tell: {attempt['message']}")
    return found


def standing_in(folder: Path) -> JournalState:
    """Return how far a run has come, by its journal; without a readable one, nothing has begun."""
    try:
        return standing_of(read_journal(folder / JOURNAL))
    except JournalError:
        return JournalState()


def main_s(folder: Path) -> float:
    """Return for how long (s, until now) a run has been in the main phase of its present test.

    It is 0 in any other phase, between tests, and without a readable journal.
    """
    try:
        entries = read_journal(folder / JOURNAL)
    except JournalError:
        return 0.0
    entered = [entry for entry in entries if entry.kind in ("phase", "outcome", "resume")]
    if not entered or entered[-1]["phase"] != Phase.MAIN:
        return 0.0
    return (datetime.now(UTC) - datetime.fromisoformat(entered[-1].at)).total_seconds()
