"""Reads and writes the journal of a campaign: one line of JSON for each thing that happens.

Lines are only appended, each before the program acts on what it reports. Each line ends with a
checksum, so that a last line that a kill or a power cut has left incomplete is recognized; all
lines before it stay valid.
"""

import fcntl
import json
import os
import threading
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

from rig.recording import read_bounded
from rig.reserves import SHORT
from rig.unique_keys import json_of

JOURNAL: Final = "journal.jsonl"
"""Name of the journal in a run's folder."""
JOURNAL_SCHEMA: Final = 1

_CHECKED: Final = b', "crc": "'
_TAIL: Final = len(_CHECKED) + len('00000000"}')


class RunFolderError(ValueError):
    """Raised for a run's folder, or a file in it, that cannot be used.

    Attributes:
        problems: the reasons, one line each.
    """

    def __init__(self, problems: str | Iterable[str]) -> None:
        self.problems = [problems] if isinstance(problems, str) else list(problems)
        super().__init__("\n".join(self.problems))


class JournalError(RunFolderError):
    """Raised for a journal that cannot be used."""


def not_of_a_campaign(folder: Path, why: ValueError) -> JournalError:
    """Return the error of a journal whose entries are not those of a campaign's."""
    remedy = "put it back from a copy, or run anew with another --out"
    return JournalError(f"{folder / JOURNAL}: is not a campaign's journal ({why}); {remedy}")


def reason_of(error: OSError) -> str:
    """Return why a file cannot be used, in words of the system, in lower case."""
    return (error.strerror or str(error)).lower()


@dataclass(frozen=True)
class Entry:
    """A line of the journal.

    Attributes:
        number: number of the line, from 0 on, without a gap.
        at: when it was written, UTC, ISO 8601.
        kind: what happened: `begin`, `resume`, `phase`, `outcome`, `operator`, `held`, `released`,
            `driven`, `refused`, `overdue` or `end`; the journal of a schedule has other kinds.
        details: the rest of the entry, by name.
    """

    number: int
    at: str
    kind: str
    details: Mapping[str, Any]

    def __getitem__(self, name: str) -> Any:
        """Return a detail by its name; None if the entry has no such detail."""
        return self.details.get(name)


def read_journal(path: Path) -> list[Entry]:
    """Return the entries of a journal, without damaged lines at its end, as a kill leaves one.

    Raises:
        JournalError: the journal cannot be read, or a valid line follows a damaged one.
    """
    return _read(path)[0]


def since_end(entries: Sequence[Entry]) -> Sequence[Entry]:
    """Return the entries by which somebody has acknowledged a run after its last other entry."""
    count = 0
    for entry in reversed(entries):
        if entry.kind != "operator" or entry["request"] != "acknowledge":
            break
        count += 1
    return entries[len(entries) - count :]


def _read(path: Path) -> tuple[list[Entry], int]:
    """Return the entries of all lines before the first damaged one, and how many bytes they take.

    Raises:
        JournalError: the file cannot be read, or a valid line follows a damaged one.
    """
    try:
        content = read_bounded(path)
    except OSError as error:
        why = f"{path}: cannot be read: {reason_of(error)}; give the folder of a run"
        raise JournalError(why) from None
    entries: list[Entry] = []
    whole = 0
    for line in content.splitlines(keepends=True):
        entry = _entry(line)
        if entry is None or entry.number != len(entries):
            break
        entries.append(entry)
        whole += len(line)
    if any(_entry(line) is not None for line in content[whole:].splitlines(keepends=True)):
        raise JournalError(
            f"{path}:{len(entries) + 1}: is damaged, and lines follow it, so that it was not a "
            "kill; restore the file, or run anew with another --out"
        )
    return entries, whole


def _entry(line: bytes) -> Entry | None:
    """Return a line as an entry; None if it is incomplete or its checksum is wrong."""
    text = line.rstrip(b"\n")
    if not line.endswith(b"\n") or text[-_TAIL:-10] != _CHECKED:
        return None
    try:
        content = json_of(text)
        if content.pop("crc") != f"{zlib.crc32(text[:-_TAIL] + b'}'):08x}":
            return None
        return Entry(content.pop("n"), content.pop("at"), content.pop("kind"), content)
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


@dataclass
class Journal:
    """Writes a journal, whose entries are appended by `write`.

    It is a context manager: on entering, the file is made if it is missing, and while the context
    is entered, the file is locked against other processes.

    Attributes:
        folder: folder of the run, which exists.
        resume: whether to append to the journal in the folder, without damaged lines at its end; if
            not, the file is emptied.
        now: returns the time of the wall clock, UTC.
        name: file name of the journal.
        busy: message of the error if another process writes the journal; a default if empty.
        entries: the entries that the journal had when it was entered, with `resume`; else empty.

    Raises:
        JournalError: on entering, if another process writes the journal, or, with `resume`, if a
            valid line follows a damaged one.
        OSError: on entering, if the journal cannot be written.
    """

    folder: Path
    _: KW_ONLY
    resume: bool = False
    now: Callable[[], datetime] = lambda: datetime.now(UTC)
    name: str = JOURNAL
    busy: str = ""
    entries: list[Entry] = field(default_factory=list, init=False)
    _number: int = field(default=0, init=False)
    _writing: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False)

    def __enter__(self) -> "Journal":
        self._file = os.open(self.folder / self.name, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
        try:
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                why = f"{self.folder}: a campaign is running in it; wait for its end, or stop it: "
                raise JournalError(self.busy or f"{why}rig control {self.folder} abort") from None
            if self.resume:
                self.entries, whole = _read(self.folder / self.name)
                self._number = len(self.entries)
                os.ftruncate(self._file, whole)
            else:
                os.ftruncate(self._file, 0)
            os.fsync(self._file)
            sync(self.folder)
        except BaseException:
            os.close(self._file)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def move_to(self, folder: Path) -> None:
        """Go on in a copy of the journal in another folder, which is made from what was written.

        Raises:
            OSError: the copy cannot be written.
        """
        path = folder / self.name
        with self._writing:
            copy = os.open(path, os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND, 0o644)
            try:
                fcntl.flock(copy, fcntl.LOCK_EX | fcntl.LOCK_NB)
                size = os.fstat(self._file).st_size
                if os.write(copy, os.pread(self._file, size, 0)) != size:
                    raise OSError(f"{path}: the disk is full")
                os.fsync(copy)
                sync(folder)
            except BaseException:
                os.close(copy)
                raise
            os.close(self._file)
            self._file, self.folder = copy, folder

    def write(self, kind: str, *, durable: bool = True, **details: Any) -> Entry:
        """Append an entry to the journal, and return it.

        Args:
            kind: what happened; see `Entry`.
            durable: whether to wait until the line is on disk, so that it survives a power cut. If
                not, it survives a kill of this process, and is on disk after the next durable line.
            details: the rest of the entry, JSON-able, without NaN and infinity, which raise
                ValueError.

        Raises:
            OSError: the line cannot be written to the end, as on a full disk.
        """
        with self._writing:
            return self._write(kind, durable, details)

    def _write(self, kind: str, durable: bool, details: Mapping[str, Any]) -> Entry:
        at = self.now().isoformat(timespec="milliseconds")
        content = {"n": self._number, "at": at, "kind": kind, **details}
        written = json.dumps(content, allow_nan=False, ensure_ascii=False)
        # A lone surrogate, which a folder's name may have, is written as the JSON escape for it.
        text = written.encode(errors="backslashreplace")
        line = text[:-1] + _CHECKED + b'%08x"}\n' % zlib.crc32(text)
        if os.write(self._file, line) != len(line):
            raise OSError(f"{self.folder / self.name}: the disk is full")
        if durable:
            os.fsync(self._file)
        self._number += 1
        return Entry(content.pop("n"), at, kind, details)


def is_written(folder: Path, name: str = JOURNAL) -> bool:
    """Return whether a process has locked a folder's journal of this name to write it.

    The result is False if there is no journal, or if this user may not open it.

    Raises:
        OSError: the system does not let it be opened now, so that nobody knows.
    """
    try:
        # Where a pipe is in its place, opening it would otherwise wait until somebody writes to it.
        file = os.open(folder / name, os.O_RDONLY | os.O_NONBLOCK)
    except OSError as error:
        if error.errno in SHORT:
            raise
        return False
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(file)
    return False


def sync(path: Path) -> None:
    """Wait until a file, or a folder's list of names, is on disk.

    On a file system that cannot do this, such as some FUSE ones, the function does nothing. If the
    path cannot be opened, OSError is raised.
    """
    file = os.open(path, os.O_RDONLY)
    try:
        os.fsync(file)
    except OSError:
        return
    finally:
        os.close(file)
