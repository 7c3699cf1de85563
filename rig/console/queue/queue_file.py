"""The file of the queue, in the folder below which a console's runs are written.

It is replaced as a whole, and on disk before a change counts, so that a kill at any moment leaves
the queue as it was before or after the change.
"""

import fcntl
import json
import os
import stat
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Final, Literal

from rig.unique_keys import RepeatedLineError, json_of

FILE_NAME: Final = "console-queue.json"
VERSION: Final = 1
MOST_QUEUED: Final = 50
"""Most campaigns in a queue: a night of ten-minute campaigns, and a list that a person can read."""
LONGEST_NAME: Final = 200
"""Most characters of a campaign's or a person's name, as in an order of the page."""
LARGEST_FILE: Final = 1 << 18
"""Most bytes that are read. A full queue and 200 offered names, in characters of 4 bytes, fit."""
LOCK_S: Final = 2.0
"""Longest time in s for which a change waits for another one, which takes some milliseconds."""
_YEAR_10000_MS: Final = 253_402_300_800_000
"""A time in ms since 1970 that no calendar of this machine shows any more."""
_AGAIN_S: Final = 0.02

Way = Literal["earlier", "later", "first"]


class QueueError(Exception):
    """The error of a queue that cannot be read or changed; its message says why, and a remedy."""


@dataclass(frozen=True)
class Queued:
    """A campaign that waits in the queue.

    Attributes:
        number: its number, which no other entry of this queue has had.
        campaign: name of the campaign, as the console offers it.
        by: who has queued it.
        at_ms: when that was, in ms since 1970.
        is_begun: whether a console was about to start it. It stands so for the moment of the start
            only; after a kill in that moment the run may exist, so that somebody should look.
    """

    number: int
    campaign: str
    by: str
    at_ms: int
    is_begun: bool = False


@dataclass(frozen=True)
class Content:
    """What a queue's file holds.

    Attributes:
        entries: the campaigns that wait, the next one first.
        marks: by which the newest entries were asked for, also of such as wait no more.
        offered: names of the campaigns that the console offered when it was started last.
        next_number: number of the next entry.
    """

    entries: tuple[Queued, ...] = ()
    offered: tuple[str, ...] = ()
    next_number: int = 1
    marks: tuple[str, ...] = ()


class QueueFile:
    """The queue of one console, which other processes may change too.

    Args:
        folder: folder below which the console's runs are written; it is made by the first change.
    """

    def __init__(self, folder: Path) -> None:
        self.path = folder / FILE_NAME

    def read(self) -> Content:
        """Return what the file holds; an empty queue if there is no file.

        Raises:
            QueueError: it cannot be read, may be written by others, or is no queue.
        """
        try:
            # A pipe of this name would otherwise wait until somebody writes to it.
            with os.fdopen(os.open(self.path, os.O_RDONLY | os.O_NONBLOCK), "rb") as file:
                state = os.fstat(file.fileno())
                others = state.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
                if not stat.S_ISREG(state.st_mode) or state.st_uid != os.geteuid() or others:
                    text = "is not this user's own file, or others may write it; remove it"
                    raise QueueError(f"{self.path}: {text}")
                return _content(file.read(LARGEST_FILE + 1))
        except FileNotFoundError:
            return Content()
        except OSError as error:
            raise QueueError(f"{self.path}: cannot be read: {error.strerror}") from None
        except RepeatedLineError as error:
            raise QueueError(error.at(self.path)) from None
        except (ValueError, TypeError, KeyError, RecursionError):
            text = "is no queue of version 1; remove it to begin with an empty queue"
            raise QueueError(f"{self.path}: {text}") from None

    def offer(self, names: Iterable[str]) -> Content:
        """Note which campaigns the console offers, so that `rig queue add` can refuse others."""
        return self._change(lambda held: replace(held, offered=tuple(names)))

    def add(self, campaign: str, by: str, mark: str = "") -> Content:
        """Add a campaign at the end of the queue, and return what the file holds then.

        Args:
            campaign: name of the campaign.
            by: who queues it.
            mark: tells this request from all others. One that was carried out before, and comes
                again as its answer was lost, changes nothing. Empty for none.

        Raises:
            QueueError: the campaign is not offered, the queue is full, or the file cannot be used.
        """

        def added(held: Content) -> Content:
            if mark and mark in held.marks:
                return held
            if campaign not in held.offered:
                offered = ", ".join(held.offered) or "nothing"
                raise QueueError(f"{campaign[:80]} is not offered; the console offers: {offered}")
            if len(held.entries) >= MOST_QUEUED:
                raise QueueError(f"the queue is full, {MOST_QUEUED} campaigns; remove one")
            at_ms = time.time_ns() // 10**6
            entry = Queued(held.next_number, campaign, by[:LONGEST_NAME], at_ms)
            entries = (*held.entries, entry)
            marks = (*held.marks, mark)[-MOST_QUEUED:] if mark else held.marks
            next_number = held.next_number + 1
            return replace(held, entries=entries, next_number=next_number, marks=marks)

        return self._change(added)

    def remove(self, number: int) -> Content:
        """Take an entry out of the queue; a `QueueError` is raised if there is none."""

        def removed(held: Content) -> Content:
            place = _place(held, number)
            return replace(held, entries=held.entries[:place] + held.entries[place + 1 :])

        return self._change(removed)

    def move(self, number: int, way: Way) -> Content:
        """Move an entry one place, or to the front; a `QueueError` is raised if there is none."""

        def moved(held: Content) -> Content:
            place, entries = _place(held, number), list(held.entries)
            entry = entries.pop(place)
            to = {"earlier": max(place - 1, 0), "later": place + 1, "first": 0}[way]
            entries.insert(to, entry)
            return replace(held, entries=tuple(entries))

        return self._change(moved)

    def begin(self, number: int, is_begun: bool) -> Content:
        """Note that an entry is about to be started, or that it was not started after all."""

        def begun(held: Content) -> Content:
            place, entries = _place(held, number), list(held.entries)
            entries[place] = replace(entries[place], is_begun=is_begun)
            return replace(held, entries=tuple(entries))

        return self._change(begun)

    def _change(self, change: Callable[[Content], Content]) -> Content:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self._locked():
                held = change(self.read())
                self._write(held)
                return held
        except OSError as error:
            raise QueueError(f"{self.path}: cannot be written: {error.strerror}") from None

    @contextmanager
    def _locked(self) -> Iterator[None]:
        """Hold the lock beside the file; the file itself is replaced by each change."""
        path = self.path.with_name(f".{FILE_NAME}.lock")
        lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
        try:
            until = time.monotonic() + LOCK_S
            while True:
                with suppress(BlockingIOError):
                    fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    break
                if time.monotonic() > until:
                    text = "is being changed by another process; try again"
                    raise QueueError(f"{self.path}: {text}")
                time.sleep(_AGAIN_S)
            yield
        finally:
            os.close(lock)

    def _write(self, held: Content) -> None:
        text = json.dumps({"version": VERSION, **asdict(held)}, ensure_ascii=False)
        # What a killed process has left under this name is overwritten: the lock is held.
        new = self.path.with_name(f".{FILE_NAME}.new")
        new.unlink(missing_ok=True)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        with os.fdopen(os.open(new, flags, 0o600), "wb") as file:
            file.write(text.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())
        new.replace(self.path)
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _place(held: Content, number: int) -> int:
    for place, entry in enumerate(held.entries):
        if entry.number == number:
            return place
    numbers = ", ".join(str(entry.number) for entry in held.entries) or "none, it is empty"
    raise QueueError(f"the queue has no entry {number}; it has: {numbers}")


def _content(text: bytes) -> Content:
    """Return what a file's text holds; ValueError, TypeError or KeyError if it is no queue."""
    if len(text) > LARGEST_FILE:
        raise ValueError("is too large")
    told = json_of(text)
    if told["version"] != VERSION:
        raise ValueError("has another version")
    entries = tuple(Queued(**each) for each in told["entries"])
    for each in entries:
        values: tuple[tuple[Any, type], ...] = (
            (each.number, int), (each.campaign, str), (each.by, str), (each.at_ms, int),
            (each.is_begun, bool),
        )  # fmt: skip
        if not all(type(value) is kind for value, kind in values):
            raise TypeError("has a value of another kind")
        if not 0 <= each.at_ms < _YEAR_10000_MS:
            raise ValueError("has a time that no calendar has")
    if type(told["next_number"]) is not int:
        raise TypeError("has a next number of another kind")
    offered = tuple(str(name) for name in told["offered"])
    highest = max((each.number for each in entries), default=0)
    marks = tuple(str(mark) for mark in told.get("marks", ()))
    return Content(entries, offered, max(told["next_number"], highest + 1), marks)
