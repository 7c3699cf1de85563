"""Judges a run in which a call failed: is it safe, does it tell the truth, can one go on."""

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rig.recording import RecordingError, recover
from rig.recording.formats.mcap_reader import read_mcap
from rig.runner.run_folder.journal import JournalError, read_journal

_CRASHED: Final = re.compile(r"Traceback \(most recent call last\)|traceback in |^Exception ", re.M)
"""What is printed by a program that met an error which it did not expect."""
LOST_S: Final = 2.0
"""s of data that a failure may cost: what is written is handed to the disk every second."""
ENDINGS: Final = (0, 1, 2, 3)
"""Exit codes of `rig run`; a signal's number below zero is that of a kill."""


@dataclass(frozen=True)
class Ended:
    """How a run ended.

    Attributes:
        exit_code: its exit code; None if it had not ended in time and was killed.
        printed: what it printed, and the log of its session's processes.
        alive: the processes that were left, by their command lines.
        killed: whether a library that found no memory ended the process, as a kill would.
    """

    exit_code: int | None
    printed: str
    alive: tuple[str, ...] = ()
    killed: bool = False


def problems_of(
    ended: Ended, folder: Path, expected_rows: dict[str, int], *, reported: bool = True
) -> list[str]:
    """Return a sentence for each point in which a run was not as it should be.

    Args:
        ended: how it ended.
        folder: its folder, which may be missing.
        expected_rows: for each recording of an untroubled run, its number of rows.
        reported: whether a run that passed writes a report.
    """
    found = []
    if ended.exit_code is None:
        found.append("it hung, and was killed")
    elif ended.exit_code not in ENDINGS and not ended.killed:
        found.append(f"it ended with exit code {ended.exit_code}")
    if ended.alive:
        found.append(f"left alive: {'; '.join(ended.alive)}")
    if _CRASHED.search(ended.printed):
        found.append("it told a crash of the program, not a cause with a remedy")
    if ended.exit_code and not ended.printed.strip():
        found.append("it told nothing")
    if reported and ended.exit_code == 0 and not (folder / "report.html").is_file():
        found.append("exit code 0 without a report")
    return found + _untruths(ended, folder, expected_rows) + _unreadable(folder)


def _untruths(ended: Ended, folder: Path, expected_rows: dict[str, int]) -> list[str]:
    """Return what a run says of itself that is not so."""
    results = _json(folder / "results.json")
    found = []
    if results is not None and ended.exit_code is not None and not ended.killed:
        told = results["exit_code"]
        # The results are written before the report, which may fail.
        if told != ended.exit_code and not (told == 0 and ended.exit_code == 1):
            found.append(f"exit code {ended.exit_code}, but {told} in results.json")
    if ended.exit_code == 0:
        if results is None or {test["status"] for test in results["tests"]} != {"passed"}:
            found.append("exit code 0 without results of passed tests")
        for name, rows in expected_rows.items():
            kept = rows_of(folder / name)
            if kept != rows:
                found.append(f"exit code 0, and {name} has {kept} rows of {rows}")
    return found


def _unreadable(folder: Path) -> list[str]:
    """Return which files of a run cannot be read, and which were left half written."""
    found = []
    if (folder / "results.json").exists() and _json(folder / "results.json") is None:
        found.append("results.json is no JSON")
    if (folder / "journal.jsonl").exists():
        try:
            read_journal(folder / "journal.jsonl")
        except JournalError as error:
            found.append(f"the journal: {error}")
    results = _json(folder / "results.json")
    tests = [] if results is None else results["tests"]
    recorded_s = {test["recording"]: test["recorded_s"] for test in tests}
    for recording in sorted(folder.glob("*.mcap")):
        rows, told_s = rows_of(recording), recorded_s.get(recording.name, 0.0)
        if rows is None and told_s:
            found.append(f"{recording.name} cannot be read, nor recovered")
        elif 1e-3 * (rows or 0) < told_s - LOST_S:
            found.append(f"{told_s:g} s were recorded, and {recording.name} has {rows} rows")
    found += [f"{path.name} is left half written" for path in sorted(folder.glob(".*.part*"))]
    return found


def rows_of(recording: Path) -> int | None:
    """Return how many rows a recording has that can be read, recovered if need be.

    None means that the file is damaged so that nothing can be said of its rows.
    """
    try:
        return len(read_mcap(str(recording)).columns["time_s"])
    except (RecordingError, OSError):
        pass
    saved = recording.with_name(f"{recording.stem}.recovered.mcap")
    try:
        recover(recording, saved)
        return len(read_mcap(str(saved)).columns["time_s"])
    except RecordingError as error:
        return 0 if "no sample can be read" in str(error) else None
    except OSError:
        return None
    finally:
        saved.unlink(missing_ok=True)


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text())
    except (OSError, ValueError):
        return None
