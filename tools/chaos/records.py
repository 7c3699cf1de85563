"""What must hold of a run's folder, however often its campaign was killed and gone on with."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rig.recording import RecordingError, read_recording
from rig.runner.journal import JOURNAL, JournalError, read_journal
from rig.runner.outcome_record import outcome_of
from rig.runner.standing import standing_of

TICK_S = 1e-3


def finished_in(folder: Path) -> dict[int, Any]:
    """Return the records of the tests that are finished, by their index; none without a journal."""
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
    """Yield the tests that were begun again after they had finished."""
    done: set[int] = set()
    for entry in read_journal(folder / JOURNAL):
        if entry.kind == "phase" and entry["phase"] == "setup" and entry["test"] in done:
            yield f"test {entry['test']} was run again"
        if entry.kind == "outcome" and outcome_of(entry["outcome"]).is_finished:
            done.add(entry["test"])


def record_problems(folder: Path, before: list[dict[int, Any]], tests: int) -> list[str]:
    """Return what is wrong with a run that was killed, and gone on with to its end.

    Args:
        folder: of the run.
        before: `finished_in` at each kill.
        tests: how many the campaign has.
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
            # Rows of a device that did not answer have no readings.
            samples = len(read_recording(folder / test["recording"], required=("time_s",)))
        except RecordingError as error:
            found.append(f"{test['name']}: {error}")
            continue
        if abs(samples * TICK_S - test["duration_s"]) > TICK_S:
            found.append(f"{test['name']}: {samples} samples of {test['duration_s']:g} s")
    standing = standing_of(read_journal(folder / JOURNAL))
    kept = [each for attempts in standing.attempts.values() for each in attempts]
    for attempt in kept:
        if attempt.recording is not None and not (folder / attempt.recording).exists():
            found.append(f"{attempt.recording}, of an attempt, is gone")
    return found
