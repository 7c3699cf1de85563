"""The folder of a sweep: what it is, the parts that are done, and in the end its table."""

import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Mapping
from datetime import datetime
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final

import pyarrow as pa

from rig.configuration import Sweep
from rig.recording import replacing
from rig.runner.run_folder import DirectoryError, file_stem

from .run_cases import sources
from .table import read_part, read_table, together, write_part, write_table

SWEEP: Final = "sweep.json"
TABLE: Final = "sweep.parquet"
PAGE: Final = "sweep.html"
SUMMARY: Final = "summary.json"
SCHEMA: Final = "rig-sweep"
_PARTS: Final = "parts"
_LOCK: Final = ".lock"
_CUT_OFF: Final = ".s*.part"
"""What a kill leaves of a file that was being written (`rig.recording.targets`)."""
_OURS: Final = (SWEEP, TABLE, PAGE, SUMMARY, _LOCK)


class SweepFolder:
    """A sweep's folder, which one process at a time may write; a context manager.

    Args:
        path: the folder: new, empty, or of an earlier sweep.
        sweep: what is run in it.
        resume: keep what an earlier run of the same sweep finished, else replace it.

    Raises:
        DirectoryError: it holds something else, another sweep, or is being written, or cannot be.
    """

    def __init__(self, path: Path, sweep: Sweep, *, resume: bool) -> None:
        self.path, self._sweep = path, sweep
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
            else:
                self._begin()
        except BlockingIOError:
            self.close()
            line = f"{path}: a sweep is running in it; wait for it, or choose another --out"
            raise DirectoryError([line]) from None
        except OSError as error:
            self.close()
            reason = (error.strerror or str(error)).lower()
            line = f"{path}: cannot be written: {reason}; choose another --out"
            raise DirectoryError([line]) from error
        except DirectoryError:
            self.close()
            raise

    def _begin(self) -> None:
        for file in (*self._parts(), *(self.path / name for name in (TABLE, PAGE, SUMMARY))):
            file.unlink(missing_ok=True)
        with replacing(self.path / SWEEP) as partial:
            partial.write_text(json.dumps(identity(self._sweep), indent=2) + "\n", encoding="utf-8")

    def __enter__(self) -> "SweepFolder":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Let others write the folder."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def _parts(self) -> list[Path]:
        return sorted((self.path / _PARTS).glob("part-*.arrow"))

    def done(self, chunks: Mapping[int, int]) -> dict[int, int]:
        """Return the chunks that are done: how many cases each has, by its number.

        A part that is damaged, by whatever, or is no chunk, is none: its cases are run again.

        Args:
            chunks: all there are, likewise.
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

    def keep(self, chunk: int, rows: pa.Table) -> None:
        """Keep the rows of a chunk, by its number, whatever happens from now on.

        Raises:
            OSError: they cannot be written.
        """
        write_part(rows, self.path / _PARTS / f"part-{chunk:08d}.arrow")

    def finish(self) -> pa.Table:
        """Make the table of all parts, which are then no longer needed; return it.

        Raises:
            OSError: it cannot be written.
        """
        path = self.path / TABLE
        if not path.exists():
            write_table(together(read_part(part) for part in self._parts()), path)
        # With whatever a kill left of a part.
        shutil.rmtree(self.path / _PARTS)
        return read_table(path)


def identity(sweep: Sweep) -> dict[str, Any]:
    """Return what a sweep is, as its folder holds it."""
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
    """Return what the sweep in a folder is; None where there is none."""
    try:
        found = json.loads((path / SWEEP).read_text(encoding="utf-8"))
        return dict(found) if found["schema"] == SCHEMA else None
    except (OSError, ValueError, TypeError, KeyError):
        return None


def default_folder(sweep: Sweep, started: datetime) -> Path:
    """Return a folder below `runs` that does not exist: the sweep's name and the time (UTC)."""
    stem = f"{file_stem(sweep.name)}-{started:%Y%m%dT%H%M%SZ}"
    number, path = 2, Path("runs") / stem
    while path.exists():
        path, number = Path("runs") / f"{stem}-{number}", number + 1
    return path


def unfinished_folder(sweep: Sweep, runs: Path) -> Path | None:
    """Return the newest folder below `runs` in which the same sweep was begun, and not finished."""
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
        before, now = kept["meaning"], found["meaning"]
        changed = [key for key in now if before.get(key) != now[key]]
        line = f"{path}: was begun as another sweep ({', '.join(changed)} changed)"
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
