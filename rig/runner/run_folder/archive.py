"""Finds, reads and removes past runs, each by its folder with its files; there is no database."""

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, Final

from rig.recording import read_bounded
from rig.unique_keys import RepeatedLineError, json_of

from .directory import RESULTS, SCHEMA, files_of_run
from .journal import (
    JOURNAL,
    Entry,
    JournalError,
    RunFolderError,
    is_written,
    read_journal,
    reason_of,
    since_end,
)

RUNS: Final = Path("runs")
"""Folder in which runs are made, and looked for, unless another one is given."""


class RunError(RunFolderError):
    """Raised for a run that is missing or cannot be read."""


@dataclass(frozen=True)
class Run:
    """A run on disk.

    Attributes:
        folder: the run's folder.
        results: the content of its `results.json`.
        state: `running` while a process writes its journal; `unfinished` if a test was not run,
            aborted or interrupted, or if its journal can be read and does not end with the entry
            `end`; else `ended`.
    """

    folder: Path
    results: Mapping[str, Any]
    state: str

    @property
    def campaign(self) -> str:
        """Name of the campaign."""
        return str(self.results["name"])

    @property
    def rig(self) -> str:
        """Name of the rig."""
        return str(self.results["rig"])

    @property
    def started(self) -> datetime:
        """When the run was begun, UTC."""
        return datetime.fromisoformat(str(self.results["started"])).astimezone(UTC)

    @property
    def tests(self) -> list[Mapping[str, Any]]:
        """The run's tests, as in `results.json`."""
        return list(self.results["tests"])

    @property
    def verdicts(self) -> set[str]:
        """The last verdict of each of the run's tests, without repetition.

        A test without a decision has no verdict.
        """
        return {str(test["found"]["verdict"]) for test in self.tests if test["found"]}

    @property
    def counts(self) -> Mapping[str, int]:
        """The number of tests with each status, by the status; a status of no test is left out."""
        return dict(self.results["counts"])

    @property
    def recordings(self) -> list[Path]:
        """Paths of the recordings of its tests, without earlier attempts and missing files."""
        return [path for path in self._named() if path.is_file()]

    @property
    def missing_recordings(self) -> list[Path]:
        """Paths of the recordings of its tests that are not there."""
        return [path for path in self._named() if not path.is_file()]

    def _named(self) -> list[Path]:
        return [self.folder / str(test["recording"]) for test in self.tests if test["recording"]]

    @property
    def size(self) -> int:
        """Size of all files that the run wrote, bytes.

        Raises:
            RunError: a file cannot be read, so that it is not known whether the run wrote it.
        """
        try:
            return sum(file.stat().st_size for file in files_of_run(self.folder))
        except OSError as error:
            line = f"{error.filename or self.folder}: cannot be read: {reason_of(error)}"
            raise RunError(f"{line}; let this user read it") from None


def read_run(folder: Path) -> Run:
    """Return the run in a folder.

    Raises:
        RunError: the folder holds no run, or the run's results are damaged, larger than
            `LARGEST_RESULTS`, or name a file outside the folder.
    """
    path = folder / RESULTS
    try:
        results = json_of(read_bounded(path))
        if not isinstance(results, dict) or results.get("schema") != SCHEMA:
            raise RunError(f"{path}: is not a run's; give the folder of a run")
        run = Run(folder, results, "")
        _check(run)
    except OSError as error:
        raise RunError(f"{folder}: holds no run: {RESULTS}: {reason_of(error)}") from None
    except RunError:
        raise
    except RepeatedLineError as error:
        raise RunError(error.at(path)) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise RunError(f"{path}: is damaged ({type(error).__name__}: {error})") from None
    return Run(folder, results, _state_of(folder, run))


def _check(run: Run) -> None:
    """Check that a run's results have what `Run` needs, and name no file outside the run's folder.

    Raises:
        RunError: a recording's name leads out of the folder.
        ValueError, KeyError, TypeError, AttributeError: something is missing or malformed.
    """
    _ = run.campaign, run.rig, run.started, run.verdicts, run.counts
    if type(code := run.results.get("exit_code")) not in (int, type(None)):
        raise ValueError(f"the exit code {code!a}")
    for test in run.tests:
        name, recording = test["name"], test["recording"]
        if not isinstance(name, str) or not isinstance(test["status"], str):
            raise ValueError("a test without name or status")
        if not name.isprintable():
            raise ValueError(f"a test's name with characters that cannot be shown: {name!a}")
        found = test["found"] or {}
        leak = found.get("leak_L_per_min")
        if not isinstance(leak, int | float | None) or not isinstance(found, dict):
            raise ValueError(f"{name}: a finding that is none")
        if not isinstance(test.get("attempts") or [], list):
            raise ValueError(f"{name}: attempts that are no list")
        if recording is not None and not is_plain(str(recording)):
            raise RunError(
                f"{run.folder / RESULTS}: {name}: recording {recording} is no file of it"
            )
    for each in run.results.get("history") or []:
        if not all(isinstance(each[key], str) for key in ("at", "who", "what")):
            raise ValueError("a happening without time, person or words")


def _state_of(folder: Path, run: Run) -> str:
    if is_written(folder):
        return "running"
    last: Sequence[Entry] = ()
    with suppress(JournalError):
        entries = read_journal(folder / JOURNAL)
        last = entries[: len(entries) - len(since_end(entries))][-1:]
    unfinished = {"not_run", "aborted", "interrupted"} & {str(test["status"]) for test in run.tests}
    return "unfinished" if unfinished or (last and last[0].kind != "end") else "ended"


def is_plain(name: str) -> bool:
    """Return whether a name can be that of an entry of a folder, without any path in it.

    It need not exist. The names "", "." and ".." are not plain.
    """
    return name not in ("", ".", "..") and not set(name) & {"/", "\\", "\0"}


def run_named(name: str, below: Path = RUNS) -> Run:
    """Return the run whose folder has a name; the name need not be trusted, as from a browser.

    Args:
        name: name of the run's folder.
        below: the folder that holds it.

    Raises:
        RunError: the name is a path or that of a link, there is no such run, or it cannot be read.
    """
    if not is_plain(name):
        raise RunError(f"{name!r}: is not the name of a run")
    if (below / name).is_symlink():
        raise RunError(f"{below / name}: is a link; runs are folders")
    return read_run(below / name)


def runs_below(folder: Path) -> Iterator[Run]:
    """Yield all readable runs in a folder and in the folders below it, oldest first.

    Folders inside a run's folder are not searched.
    """
    found = []
    for path, folders, files in os.walk(folder):
        if RESULTS in files:
            folders.clear()
            with suppress(RunError):
                found.append(read_run(Path(path)))
    yield from sorted(found, key=lambda run: (run.started, run.folder))


def prunable(
    runs: Iterable[Run], *, keep: int, older_than: timedelta | None, now: datetime
) -> list[Run]:
    """Return the runs that may be removed, oldest first.

    A run that is running or unfinished is never returned.

    Args:
        runs: all runs.
        keep: how many of the newest runs of each campaign on each rig stay, also counting runs that
            are running or unfinished.
        older_than: a run stays unless it began longer ago than this; None for no limit.
        now: the present time, UTC.
    """
    by_kind: dict[tuple[str, str], list[Run]] = defaultdict(list)
    for run in sorted(runs, key=lambda run: run.started):
        by_kind[run.campaign, run.rig].append(run)
    old = [run for kind in by_kind.values() for run in kind[: max(len(kind) - keep, 0)]]
    return [
        run
        for run in sorted(old, key=lambda run: run.started)
        if run.state == "ended" and (older_than is None or now - run.started > older_than)
    ]


def remove(run: Run) -> list[str]:
    """Remove the files that a run wrote, and its folder if it is empty then.

    Returns:
        The names of other files in the folder, which stay; empty if the folder was removed. If the
        run is running, nothing is removed, and the list has one message that says so.

    Raises:
        OSError: a file cannot be removed; some files may have been removed before.
    """
    if is_written(run.folder):
        return [f"{run.folder}: is running"]
    for file in files_of_run(run.folder):
        file.unlink()
    with suppress(OSError):
        run.folder.rmdir()
    return sorted(path.name for path in run.folder.iterdir()) if run.folder.exists() else []
