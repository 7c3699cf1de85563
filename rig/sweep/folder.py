"""Keeps a sweep in its folder: its identity, the parts that are finished, and later its table."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from rig.configuration import Sweep
from rig.recording import read_bounded, replace_text
from rig.runner.run_folder import DirectoryError
from rig.unique_keys import json_of

from .changes import changes
from .run_cases import sources
from .table import read_part, read_table, write_part, write_table

SWEEP: Final = "sweep.json"
TABLE: Final = "sweep.parquet"
PAGE: Final = "sweep.html"
SUMMARY: Final = "summary.json"
SCHEMA: Final = "rig-sweep"
_PARTS: Final = "parts"
_LOCK: Final = ".lock"
_CUT_OFF: Final = ".s*.part"
"""Pattern of incomplete files that a kill leaves (`rig.recording.targets`)."""
_OURS: Final = (SWEEP, TABLE, PAGE, SUMMARY, _LOCK)


class SweepFolder:
    """A sweep's folder, which is locked so that only one process at a time writes it.

    It is a context manager: leaving it ends the lock.

    Args:
        path: a new or empty folder, or that of an earlier sweep.
        sweep: the sweep to run.
        resume: whether to keep the cases that an earlier run of the same sweep has finished; if
            not, an earlier sweep is deleted.

    Raises:
        DirectoryError: the folder holds other files than a sweep's; with `resume`, it holds another
            sweep or one of another version of this program; another process writes it; or it cannot
            be written.
    """

    def __init__(self, path: Path, sweep: Sweep, *, resume: bool) -> None:
        self.path = path
        self._lock: int | None = None
        try:
            _refuse_others(path)
            (path / _PARTS).mkdir(parents=True, exist_ok=True)
            self._lock = os.open(path / _LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for left in path.glob(_CUT_OFF):
                left.unlink(missing_ok=True)
            kept = read_identity(path)
            if resume and kept is not None:
                _require_same(path, kept, identity(sweep))
                return
            for file in (*self._parts(), *(path / name for name in (TABLE, PAGE, SUMMARY))):
                file.unlink(missing_ok=True)
            replace_text(path / SWEEP, json.dumps(identity(sweep), indent=2) + "\n")
            return
        except BlockingIOError:
            problem = f"{path}: a sweep is running in it; wait for it, or choose another --out"
        except OSError as error:
            reason = (error.strerror or str(error)).lower()
            problem = f"{path}: cannot be written: {reason}; choose another --out"
        except DirectoryError as error:
            problem = str(error)
        self.close()
        raise DirectoryError([problem])

    def __enter__(self) -> "SweepFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Unlock the folder for other processes."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _parts(self) -> list[Path]:
        return sorted((self.path / _PARTS).glob("part-*.arrow"))

    def done(self, chunks: Mapping[int, int]) -> dict[int, int]:
        """Return the number of cases of each finished chunk, by the chunk's number.

        If the folder has the sweep's table, all chunks are finished. The file of a chunk is deleted
        if it is damaged, or has not as many cases as the chunk; these cases are then run again.

        Args:
            chunks: number of cases of each chunk of the sweep, by the chunk's number.
        """
        if (self.path / TABLE).exists():
            return dict(chunks)
        found = {}
        for part in self._parts():
            try:
                chunk = int(part.stem.partition("-")[2]), read_part(part).num_rows
            except (OSError, ValueError, pa.ArrowException):
                chunk = (-1, 0)
            if chunks.get(chunk[0]) == chunk[1]:
                found[chunk[0]] = chunk[1]
            else:
                part.unlink(missing_ok=True)
        return found

    def rows(self) -> Iterator[pa.Table]:
        """Yield the rows of each chunk that is finished; none once the folder has its table."""
        if not (self.path / TABLE).exists():
            yield from map(read_part, self._parts())

    def keep(self, chunk: int, rows: pa.Table) -> None:
        """Write the rows of a chunk to the folder; they are on disk when this returns.

        Args:
            chunk: number of the chunk.
            rows: its rows.

        Raises:
            OSError: the rows cannot be written.
        """
        write_part(rows, self.path / _PARTS / f"part-{chunk:08d}.arrow")

    def finish(self) -> pa.Table:
        """Write the table of all parts, delete the parts, and return the table.

        A table that the folder has already is not written again.

        Raises:
            OSError: the table cannot be written.
        """
        path = self.path / TABLE
        if not path.exists():
            write_table(map(read_part, self._parts()), path)
        # This also removes an incomplete part that a kill has left.
        shutil.rmtree(self.path / _PARTS)
        return read_table(path)


def identity(sweep: Sweep) -> dict[str, Any]:
    """Return what identifies a sweep, JSON-able: name, file, meaning, and two hashes.

    `sha256` is the hash of the sweep's meaning, `sources` that of the program's sources.
    """
    text = json.dumps(sweep.meaning, sort_keys=True)
    return {
        "schema": SCHEMA,
        "name": sweep.name,
        "file": str(sweep.path),
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
        "sources": sources(),
        "meaning": sweep.meaning,
    }


def read_identity(path: Path) -> dict[str, Any] | None:
    """Return the identity of the sweep in a folder; None if the folder holds no sweep."""
    try:
        found = json_of(read_bounded(path / SWEEP))
        texts = (found["name"], found["file"], found["sha256"], found["sources"])
        is_one = isinstance(found["meaning"], dict) and all(isinstance(each, str) for each in texts)
        return dict(found) if found["schema"] == SCHEMA and is_one else None
    except (OSError, ValueError, TypeError, KeyError, RecursionError):
        return None


def unfinished_folder(sweep: Sweep, runs: Path) -> Path | None:
    """Return the newest folder in `runs` with an unfinished run of the same sweep.

    A run is unfinished if its folder has no table yet; it may have been begun by another version of
    this program. The newest is that whose `sweep.json` is newest. Folders further below are not
    searched. The result is None if there is no such folder.
    """
    same = identity(sweep)["sha256"]
    begun = [
        folder.parent
        for folder in runs.glob(f"*/{SWEEP}")
        if (read_identity(folder.parent) or {}).get("sha256") == same
        and not (folder.parent / TABLE).exists()
    ]
    return max(begun, key=lambda folder: (folder / SWEEP).stat().st_mtime, default=None)


def _require_same(path: Path, kept: Mapping[str, Any], found: Mapping[str, Any]) -> None:
    if kept["sha256"] != found["sha256"]:
        changed = ", ".join(changes(kept["meaning"], found["meaning"]))
        line = f"{path}: was begun as another sweep ({changed} changed)"
    elif kept["sources"] != found["sources"]:
        line = f"{path}: was begun by another version of this program"
    else:
        return
    raise DirectoryError([f"{line}; give another --out, or leave --resume out to replace it"])


def _refuse_others(path: Path) -> None:
    if not path.exists():
        return
    if not path.is_dir():
        raise DirectoryError([f"{path}: is a file; give --out a folder"])
    inside = sorted(entry.name for entry in path.iterdir())
    begun = {name for name in inside if not fnmatch(name, _CUT_OFF)} <= {_LOCK, _PARTS}
    if inside and not begun and read_identity(path) is None:
        other = next((name for name in inside if name not in _OURS), inside[0])
        raise DirectoryError(
            [f"{path}: holds {other}, and no sweep that could be replaced; give --out a new or "
             "empty folder"]
        )  # fmt: skip
