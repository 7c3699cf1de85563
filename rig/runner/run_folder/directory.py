"""Makes the folder of a run, and knows its files; only files of an earlier run are replaced."""

import re
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Final

from rig.control_socket import SOCKET
from rig.recording import read_bounded
from rig.unique_keys import json_of

from .journal import JOURNAL, JournalError, RunFolderError, is_written, read_journal, reason_of

RESULTS: Final = "results.json"
JUNIT: Final = "junit.xml"
REPORT: Final = "report.html"
ERRORS: Final = "errors.log"
SCHEMA: Final = "rig-results"
"""Value of the key `schema`, by which `results.json` of a run is recognized."""

_OTHERS: Final = (SOCKET, JUNIT, REPORT, ERRORS, RESULTS)
_SESSION_FILES: Final = ("session.log", "trip-[0-9]*.json", "trip-[0-9]*.txt", "trip-[0-9]*.csv")
"""Further files that a session with a rig on hardware writes (`rig.supervisor`), as patterns."""
_PROBE: Final = ".probe-"
"""Beginning of the name of the file by which it is tried whether a folder can be written to."""
_LIBRARY: Final = b"rig.recording "
"""Text in the header of every recording that `McapWriter` writes, by which one is recognized."""
ATTEMPT: Final = "~"
"""Character before the number of an earlier attempt in its recording's name; no other file's name
has it."""
_LONGEST_NAME: Final = 100


class DirectoryError(RunFolderError):
    """Raised for a folder to which the results of a run cannot be written."""


def default_directory(name: str, started: datetime) -> Path:
    """Return the path of a new folder below `runs`, named by the campaign and the time (UTC).

    The folder is not made. A number is added to the name if that folder exists.
    """
    return new_path(Path("runs"), name, started)


def new_path(below: Path, name: str, at: datetime) -> Path:
    """Return the path NAME-TIME for a new folder in the folder `below`; nothing is made.

    If it exists, the path is NAME-TIME-2, -3 and so on. `at` is the time, UTC.
    """
    return below / first_free(
        f"{file_stem(name)}-{at:%Y%m%dT%H%M%SZ}", lambda each: (below / each).exists()
    )


def first_free(stem: str, taken: Callable[[str], bool]) -> str:
    """Return the first of the names STEM, STEM-2, STEM-3, ... that is not taken."""
    numbered = (f"{stem}-{number}" for number in count(2))
    return next(name for name in chain([stem], numbered) if not taken(name))


def prepare_directory(path: Path, recordings: Iterable[str]) -> None:
    """Make a run's folder, and delete all files of an earlier run in it.

    Args:
        path: the folder; missing parents are made, too.
        recordings: file names of the recordings that the run will write.

    Raises:
        DirectoryError: the path is not a folder; a campaign is running in it; it cannot be written
            to; or it holds files but no earlier run, or other files with names that the run needs.
    """
    with _writing(path):
        if is_written(path):
            line = f"{path}: a campaign is running in it; choose another --out"
            raise DirectoryError(f"{line}, or stop it: rig control {path} abort")
        earlier = files_of_run(path)
        _refuse_others(path, earlier, recordings)
        for file in earlier:
            file.unlink()
        path.mkdir(parents=True, exist_ok=True)
        # Permissions alone do not show whether a file can be made.
        with NamedTemporaryFile(dir=path, prefix=_PROBE, delete=False) as probe:
            pass
        # If it cannot be removed, that is no reason not to run.
        with suppress(OSError):
            Path(probe.name).unlink()


def make_empty(directory: Path) -> None:
    """Make a folder for the files of an experiment; if it exists, it must be empty.

    Raises:
        DirectoryError: the path is a file, the folder is not empty, or it cannot be made.
    """
    if directory.exists() and not directory.is_dir():
        raise DirectoryError(f"{directory}: is a file; give --out a folder")
    if directory.is_dir() and any(directory.iterdir()):
        raise DirectoryError(f"{directory}: is not empty; give --out a new or empty folder")
    with _writing(directory):
        directory.mkdir(parents=True, exist_ok=True)


@contextmanager
def _writing(path: Path) -> Iterator[None]:
    """Replace an OSError of the context by a DirectoryError that `path` cannot be written."""
    try:
        yield
    except OSError as error:
        line = f"{path}: cannot be written: {reason_of(error)}; choose another --out"
        raise DirectoryError(line) from error


def log_error(directory: Path, what: str) -> Path:
    """Append the traceback of the present exception to a run's `errors.log`; return that path.

    Args:
        directory: folder of the run.
        what: line of text above the traceback, which says what failed.
    """
    path = directory / ERRORS
    with path.open("a", encoding="utf-8") as log:
        log.write(f"{what}\n{traceback.format_exc()}\n")
    return path


def recording_names(tests: Iterable[str]) -> list[str]:
    """Return a file name of a recording for each test's name, in their order.

    The names differ from each other by more than upper and lower case.
    """
    names: dict[str, str] = {}
    for test in tests:
        name = first_free(file_stem(test), lambda each: each.lower() in names)
        names[name.lower()] = f"{name}.mcap"
    return list(names.values())


def attempt_path(recording: Path, number: int) -> Path:
    """Return the path NAME~NUMBER.mcap for an earlier attempt's recording; NUMBER is from 1 on."""
    return recording.with_name(f"{recording.stem}{ATTEMPT}{number}{recording.suffix}")


def file_stem(name: str) -> str:
    """Return a name as the stem of a file name, with at most 100 characters.

    It has only ASCII letters, digits, `.`, `_` and `-`, of which it begins and ends with a letter
    or digit. It is `test` if nothing else is left.
    """
    stem = re.sub(r"[^A-Za-z0-9._-]+", "_", name)[:_LONGEST_NAME].strip("._-")
    return stem or "test"


def _refuse_others(path: Path, earlier: list[Path], recordings: Iterable[str]) -> None:
    if not path.exists():
        return
    if not path.is_dir():
        raise DirectoryError(f"{path}: is a file; give --out a folder")
    found = (file for file in path.iterdir() if not file.name.startswith(_PROBE))
    others = sorted(set(found) - set(earlier))
    if others and not earlier:
        raise DirectoryError(
            f"{path}: holds {others[0].name}, and no results of an earlier run that could be "
            "replaced; give --out a new or empty folder"
        )
    names = {JOURNAL, RESULTS, JUNIT, REPORT, ERRORS, *recordings}
    in_the_way = [file for file in others if file.name in names]
    if in_the_way:
        raise DirectoryError(
            f"{file}: was not written by the earlier run; move it away" for file in in_the_way
        )


def files_of_run(path: Path) -> list[Path]:
    """Return the existing files that a run wrote to its folder; empty if it holds no run.

    The names of the tests in results or journal say which recordings belong to the run. Without
    these two files there is no run: recordings alone may be a user's collection.

    Raises:
        OSError: a file cannot be read, so that it is not known whether the run wrote it.
    """
    tests = _tests_of(path)
    if tests is None:
        return []
    # The tests' names also lead to recordings that a killed run could not list in its results.
    recordings = [path / name for name in recording_names(tests)]
    stems = {recording.stem for recording in recordings}
    attempts = [
        file
        for file in sorted(path.glob(f"*{ATTEMPT}*.mcap"))
        for stem, _, number in [file.stem.rpartition(ATTEMPT)]
        if stem in stems and number.isdigit()
    ]
    found = [path / JOURNAL] if (path / JOURNAL).is_file() else []
    found += [file for file in (*recordings, *attempts) if file.is_file() and _is_ours(file)]
    found += [file for pattern in _SESSION_FILES for file in sorted(path.glob(pattern))]
    return found + [path / name for name in _OTHERS if (path / name).exists()]


def _tests_of(folder: Path) -> list[str] | None:
    """Return the names of a run's tests by its results, or by its journal if it has no results.

    The result is None if neither file is there, or neither is a run's. The list is empty if the
    journal has no entry yet.

    Raises:
        OSError: `results.json` is there and cannot be read.
    """
    with suppress(FileNotFoundError, NotADirectoryError, ValueError, TypeError, KeyError):
        content = json_of(read_bounded(folder / RESULTS))
        names = [str(test["name"]) for test in content["tests"]]
        if content["schema"] == SCHEMA:
            return names
    with suppress(JournalError, TypeError):
        entries = read_journal(folder / JOURNAL)
        return [str(test) for test in entries[0]["tests"]] if entries else []
    return None


def _is_ours(file: Path) -> bool:
    with file.open("rb") as opened:
        return _LIBRARY in opened.read(256)
