"""The desk of a running campaign: what operators ask of it, from the command line or a console."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final

from .stopping import StopFlag

LONGEST_TEXT: Final = 1000
"""Characters of a note."""
LONGEST_TEST: Final = 500
"""Characters of a test's name that is asked for."""
_PATIENCE_S: Final = 5.0

Write = Callable[..., object]


class Request(StrEnum):
    """What an operator may ask for."""

    PAUSE = "pause"
    """Wait, once the present test has come to its end."""
    RESUME = "resume"
    """Go on after a pause."""
    ABORT = "abort"
    """End the campaign at once, as Ctrl-C does."""
    SKIP = "skip"
    """Do not run a test; end it, if it runs."""
    RETRY = "retry"
    """Run a test again; end it first, if it runs."""
    NOTE = "note"
    """Keep a text in the record."""
    ACKNOWLEDGE = "acknowledge"
    """Say in the record that all that wants attention was seen."""
    STATUS = "status"
    """The answer is how the campaign goes on; it changes nothing."""


class RefusedError(ValueError):
    """What was asked for cannot be done now; says why."""


@dataclass(frozen=True)
class Note:
    """What an operator wrote."""

    who: str
    text: str


class Desk:
    """Takes requests from any thread, and has the campaign's thread know of them.

    A request is in the journal before it is answered. The campaign's thread asks for what is due
    between two batches and between two tests.
    """

    def __init__(self) -> None:
        self._stop = StopFlag()
        self._lock = threading.Lock()
        self._write: Write | None = None
        self._names: Sequence[str] = ()
        self._present: int | None = None
        self._last: int | None = None
        self._phase = ""
        self._statuses: dict[int, str] = {}
        self._held: Sequence[str] = ()
        self._attention: list[str] = []
        self._notes: list[Note] = []
        self._paused = False
        self._interruption: Request | None = None
        self._changed: Callable[[bool, Sequence[str]], None] = lambda pausing, held: None

    # -- the campaign's thread --------------------------------------------------------------------

    def open(
        self, names: Sequence[str], statuses: Mapping[int, str], write: Write, stop: StopFlag
    ) -> None:
        """Begin to take requests.

        Args:
            names: of the campaign's tests.
            statuses: of those that were run already, by their index.
            write: writes to the journal; only ever called with the desk's lock held.
            stop: ends the campaign.
        """
        with self._lock:
            self._names, self._statuses = names, dict(statuses)
            self._write, self._stop = write, stop

    def on_change(self, changed: Callable[[bool, Sequence[str]], None]) -> None:
        """Have a function called with whether a pause is asked for, and what else holds.

        It is called from any thread whenever one of the two changes.
        """
        self._changed = changed

    def close(self) -> None:
        """Take no more requests."""
        with self._lock:
            self._write = None

    def record(self, kind: str, **details: Any) -> None:
        """Write to the journal, between the requests of operators.

        Nothing is written where somebody has held the desk for 5 s: the disk hangs, and who would
        end the process shall not hang as well.
        """
        if not self._lock.acquire(timeout=_PATIENCE_S):
            return
        try:
            if self._write is not None:
                self._write(kind, **details)
        finally:
            self._lock.release()

    def begins(self, index: int) -> None:
        """Take note of the test that begins."""
        with self._lock:
            self._present, self._interruption = index, None

    def enters(self, phase: str) -> None:
        """Take note of the phase that the present test enters."""
        with self._lock:
            self._phase = phase

    def ends(self, index: int, status: str, *, attention: bool) -> None:
        """Take note of how a test ended, and whether somebody should look at it."""
        with self._lock:
            self._present, self._last, self._phase = None, index, ""
            self._statuses[index] = status
            if attention:
                self._attention.append(f"{self._names[index]}: {status}")

    def held_by(self, reasons: Sequence[str]) -> None:
        """Take note of the reasons why the campaign is held; without any it is not held."""
        with self._lock:
            if reasons and not self._held:
                self._attention += reasons
            changed, self._held = list(reasons) != list(self._held), reasons
        if changed:
            self._changed(self._paused, self._held)

    @property
    def paused(self) -> bool:
        """Whether to wait before the next test."""
        return self._paused

    @property
    def interruption(self) -> Request | None:
        """SKIP or RETRY, if the present test is to be ended at once."""
        return self._interruption

    def take_notes(self) -> list[Note]:
        """Return the notes since last asked for."""
        with self._lock:
            notes, self._notes = self._notes, []
        return notes

    # -- operators --------------------------------------------------------------------------------

    def ask(self, request: Request, who: str, text: str = "", test: str = "") -> str:
        """Ask for something; return in a sentence what will come of it.

        A text is kept on one line: its control characters become spaces.

        Args:
            request: what.
            who: asks.
            text: of a note; may go with anything else.
            test: name of the test to skip or retry; the present one, else the next to skip or the
                last to retry.

        Raises:
            RefusedError: it cannot be done; nothing was written. To abort is never refused because
                the journal cannot be written: the campaign ends all the same.
        """
        _check(text, "text", LONGEST_TEXT)
        _check(test, "test's name", LONGEST_TEST)
        text = "".join(sign if sign.isprintable() else " " for sign in text)
        who = who.encode(errors="replace").decode()
        with self._lock:
            if self._write is None:
                raise RefusedError("the campaign is not running")
            index = self._index(request, test) if request in (Request.SKIP, Request.RETRY) else None
            reply = self._checked(request, text, index)
            details: dict[str, Any] = {"text": text} if text else {}
            if index is not None:
                details |= {"test": index, "running": index == self._present}
            if request is Request.ACKNOWLEDGE:
                details |= {"seen": list(self._attention)}
            try:
                self._write("operator", request=str(request), who=who, **details)
            except OSError as error:
                if request is not Request.ABORT:
                    raise RefusedError(f"the journal cannot be written: {error}") from None
                reply += f", but the journal cannot be written: {error}"
            self._obey(request, who, text, index)
        if request in (Request.PAUSE, Request.RESUME):
            self._changed(self._paused, self._held)
        return reply

    def status(self) -> dict[str, Any]:
        """Return how the campaign goes on, as JSON holds it."""
        with self._lock:
            state = "running" if self._present is not None else "between tests"
            if self._present is None and (self._paused or self._held):
                state = "paused" if self._paused else "held"
            return {
                "state": state if self._write is not None else "ended",
                "pausing": self._paused,
                "held": list(self._held),
                "test": None if self._present is None else self._names[self._present],
                "phase": self._phase,
                "tests": len(self._names),
                "ended": {self._names[index]: status for index, status in self._statuses.items()},
                "attention": list(self._attention),
            }

    def _index(self, request: Request, test: str) -> int:
        if test:
            if test not in self._names:
                known = ", ".join(self._names[:20])
                raise RefusedError(f"there is no test {test!r} in the campaign; tests: {known}")
            return self._names.index(test)
        if self._present is not None:
            return self._present
        if request is Request.RETRY and self._last is not None:
            return self._last
        raise RefusedError(f"no test runs; name the one to {request}")

    def _checked(self, request: Request, text: str, index: int | None) -> str:
        """Return the answer to a request that can be obeyed."""
        name = "" if index is None else self._names[index]
        running = index is not None and index == self._present
        match request:
            case Request.PAUSE:
                after = "" if self._present is None else f" after {self._names[self._present]}"
                return f"pauses{after}; go on with resume"
            case Request.RESUME if not self._paused:
                raise RefusedError("the campaign is not paused")
            case Request.RESUME:
                held = f", but is held: {'; '.join(self._held)}" if self._held else ""
                return f"goes on{held}"
            case Request.ABORT:
                return "is stopped; go on later with `rig run --resume`"
            case Request.SKIP if index in self._statuses and not running:
                raise RefusedError(f"{name} was run already: {self._statuses[index]}")
            case Request.SKIP:
                return f"ends and skips {name}" if running else f"will skip {name}"
            case Request.RETRY if not running and index not in self._statuses:
                raise RefusedError(f"{name} has not been run yet")
            case Request.RETRY:
                return f"ends {name} and runs it again" if running else f"will run {name} again"
            case Request.NOTE if not text.strip():
                raise RefusedError("a note needs a text")
            case Request.STATUS:
                raise RefusedError("is answered by status()")
        if request is Request.ACKNOWLEDGE and self._attention:
            return f"acknowledged: {'; '.join(self._attention)}"
        return "noted" if request is Request.NOTE else "acknowledged; nothing wanted attention"

    def _obey(self, request: Request, who: str, text: str, index: int | None) -> None:
        running = index is not None and index == self._present
        if text:
            self._notes.append(Note(who, f"{request}: {text}" if request != "note" else text))
        match request:
            case Request.PAUSE | Request.RESUME:
                self._paused = request is Request.PAUSE
            case Request.ABORT:
                self._stop.request(f"{who}: {text}" if text else who)
            case Request.ACKNOWLEDGE:
                self._attention.clear()
            case Request.SKIP | Request.RETRY if running:
                self._interruption = request
            case Request.RETRY if index is not None:
                del self._statuses[index]


def _check(text: str, what: str, longest: int) -> None:
    """Look whether a text is one that a file or a screen can have.

    Raises:
        RefusedError: it is not, or is too long.
    """
    if len(text) > longest:
        raise RefusedError(f"a {what} of {len(text)} characters; at most {longest}")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise RefusedError(f"a {what} that is no UTF-8") from None
