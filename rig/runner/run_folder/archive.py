"""Past runs: nothing but their folders, found by what their results and journals say."""

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from .directory import RESULTS, SCHEMA, files_of_run
from .journal import JOURNAL, JournalError, is_written, read_journal

RUNS: Final = Path("runs")
"""Where runs are looked for, and made, unless another folder is given."""
LARGEST_RESULTS: Final = 1 << 28
"""Bytes: what is larger is no `results.json` of ours."""


class RunError(ValueError):
    """A run that cannot be read, or is not there.

    Attributes:
        problems: why, one line each.
    """

    def __init__(self, problem: str) -> None:
        self.problems = [problem]
        super().__init__(problem)


@dataclass(frozen=True)
class Run:
    """A run on disk.

    Attributes:
        folder: of the run.
        results: `results.json`.
        state: `ended`, `running` or `unfinished`: of the last `rig run --resume` makes the rest.
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
        """When it was begun, UTC."""
        return datetime.fromisoformat(str(self.results["started"])).astimezone(UTC)

    @property
    def tests(self) -> list[Mapping[str, Any]]:
        """Its tests, as in `results.json`."""
        return list(self.results["tests"])

    @property
    def verdicts(self) -> set[str]:
        """The verdicts that any of its tests came to."""
        return {str(test["found"]["verdict"]) for test in self.tests if test["found"]}

    @property
    def counts(self) -> Mapping[str, int]:
        """How many tests ended in which way."""
        return dict(self.results["counts"])

    @property
    def recordings(self) -> list[Path]:
        """Recordings of its tests that are there."""
        names = [test["recording"] for test in self.tests if test["recording"]]
        return [path for path in (self.folder / str(name) for name in names) if path.is_file()]

    @property
    def size(self) -> int:
        """Bytes of its files."""
        return sum(file.stat().st_size for file in files_of_run(self.folder))


def read_run(folder: Path) -> Run:
    """Return the run in a folder.

    Raises:
        RunError: there is none, or its results are damaged or name files outside of the folder.
    """
    path = folder / RESULTS
    try:
        if path.stat().st_size > LARGEST_RESULTS:
            raise RunError(f"{path}: is too large for the results of a run")
        results = json.loads(path.read_bytes())
        if not isinstance(results, dict) or results.get("schema") != SCHEMA:
            raise RunError(f"{path}: is not a run's; give the folder of a run")
        run = Run(folder, results, "")
        _check(run)
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise RunError(f"{folder}: holds no run: {RESULTS}: {reason}") from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        if isinstance(error, RunError):
            raise
        raise RunError(f"{path}: is damaged ({type(error).__name__}: {error})") from None
    return Run(folder, results, _state_of(folder, run))


def _check(run: Run) -> None:
    """Look whether all is there that is asked for later, and names nothing outside."""
    _ = run.campaign, run.rig, run.started, run.verdicts, run.counts
    for test in run.tests:
        name, recording = test["name"], test["recording"]
        if not isinstance(name, str) or not isinstance(test["status"], str):
            raise ValueError("a test without name or status")
        if recording is not None and not is_plain(str(recording)):
            raise RunError(
                f"{run.folder / RESULTS}: {name}: recording {recording} is no file of it"
            )


def _state_of(folder: Path, run: Run) -> str:
    if is_written(folder):
        return "running"
    try:
        last = read_journal(folder / JOURNAL)[-1:]
    except JournalError:
        last = []
    unfinished = {"not_run", "aborted", "interrupted"} & {str(test["status"]) for test in run.tests}
    return "unfinished" if unfinished or (last and last[0].kind != "end") else "ended"


def is_plain(name: str) -> bool:
    """Return whether a name is that of a file or folder, and does not lead to another place."""
    return name not in ("", ".", "..") and not set(name) & {"/", "\\", "\0"}


def run_named(name: str, below: Path = RUNS) -> Run:
    """Return a run by the name of its folder; for names that come from elsewhere, as a browser.

    Raises:
        RunError: the name is a path, or there is no such run.
    """
    if not is_plain(name):
        raise RunError(f"{name!r}: is not the name of a run")
    if (below / name).is_symlink():
        raise RunError(f"{below / name}: is a link; runs are folders")
    return read_run(below / name)


def runs_below(folder: Path) -> Iterator[Run]:
    """Yield the readable runs in the folders below one, at any depth, oldest first."""
    found = []
    for path, folders, files in os.walk(folder):
        if RESULTS in files:
            folders.clear()
            try:
                found.append(read_run(Path(path)))
            except RunError:
                continue
    yield from sorted(found, key=lambda run: (run.started, run.folder))
