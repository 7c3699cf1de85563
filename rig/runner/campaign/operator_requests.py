"""The desk of a running campaign, which takes operators' requests from command line and console."""

import threading
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from math import inf
from typing import TYPE_CHECKING, Any, Final

from rig.control_socket import remark_of

from .stopping import StopFlag

if TYPE_CHECKING:
    # Asking a campaign by `rig control` must not load the configuration.
    from .control_change import ControlChange, RunningControl

LONGEST_TEXT: Final = 1000
"""Most characters of the text of a request."""
LONGEST_PERSON: Final = 64
"""Most characters of the name of who made a request; a longer one is cut off."""
LONGEST_TEST: Final = 500
"""Most characters of a test's name in a request."""
MOST_REFUSED: Final = 100
"""Refused requests that the journal keeps, so that a flood of requests cannot fill the disk."""
_PATIENCE_S: Final = 5.0

Write = Callable[..., object]
Changed = Callable[[bool, Sequence[str]], None]
"""Takes whether a pause is requested, and the reasons why conditions hold the campaign."""


class Request(StrEnum):
    """A request that an operator may make."""

    PAUSE = "pause"
    """Pause the campaign after the present test."""
    RESUME = "resume"
    """Go on after a pause."""
    ABORT = "abort"
    """End the campaign at once, as Ctrl-C does."""
    SKIP = "skip"
    """Leave a test out; if it is running, end it."""
    RETRY = "retry"
    """Run a test again; if it is running, end it first."""
    NOTE = "note"
    """Write a text to the journal, and to the recording of the present or the next test."""
    SET = "set"
    """Change the control of the test that runs, without a bump in its command."""
    ACKNOWLEDGE = "acknowledge"
    """Write to the journal that the operator has noticed all that wants attention, and clear it."""
    STATUS = "status"
    """Get the state of the campaign; this changes nothing."""


class RefusedError(ValueError):
    """Raised for a request that is not carried out; the message says why."""


class Desk:
    """Takes operators' requests from any thread, and keeps them for the campaign's thread.

    A request is written to the journal before it is answered. The campaign's thread looks for
    requests between two batches and between two tests.

    Attributes:
        paused: whether the campaign is to wait before its next test.
        paused_by: who has asked for that; empty if nobody has.
        interruption: SKIP or RETRY if the present test is to be ended at once, else None; it stays
            until the next test begins.
    """

    def __init__(self) -> None:
        self._stop = StopFlag()
        self._lock = threading.Lock()
        self._write: Write | None = None
        self._early: list[tuple[str, dict[str, Any]]] | None = None
        """What was asked before `open`, for the journal; None while nothing may be asked."""
        self._refused = 0
        self._names: Sequence[str] = ()
        self._present: int | None = None
        self._last: int | None = None
        self._phase = ""
        self._control: RunningControl | None = None
        self._statuses: dict[int, str] = {}
        self._held: Sequence[str] = ()
        self._attention: list[str] = []
        self._notes: list[str] = []
        self.paused = False
        self.paused_by = ""
        self.interruption: Request | None = None
        self._changed: Changed

    # -- the campaign's thread --------------------------------------------------------------------

    def prepare(self, stop: StopFlag) -> None:
        """Take ABORT from now on, which requests a stop on the flag, and nothing else.

        So a campaign is stopped whose rig is not ready yet, as while it is compiled.
        """
        with self._lock:
            self._stop, self._early = stop, []

    def begun(self) -> None:
        """Write to the journal what was asked before `open`, once its first entry is written."""
        with self._lock:
            early, self._early = self._early or [], []
            for kind, details in early:
                if self._write is not None:
                    self._write(kind, **details)

    def refuse(self, why: str) -> None:
        """Write to the journal that a request was refused, and why; of a flood only the first."""
        self._refused += 1
        if self._refused > MOST_REFUSED:
            return
        with self._lock:
            if self._write is None and self._early is not None:
                self._early.append(("refused", {"why": why}))
                return
        self.record("refused", why=why, durable=False)

    def open(
        self,
        names: Sequence[str],
        statuses: Mapping[int, str],
        write: Write,
        stop: StopFlag,
        changed: Changed = lambda pausing, held: None,
    ) -> None:
        """Begin to take requests.

        Args:
            names: names of the campaign's tests.
            statuses: status of each test that is finished already, by the test's index.
            write: writes an entry to the journal, given its kind and its details as keywords; it is
                only called while the desk is locked.
            stop: the campaign's flag, on which the desk requests a stop when an operator asks to
                ABORT.
            changed: is called from any thread after each PAUSE or RESUME, and when the reasons for
                a hold change; they are empty if no condition holds the campaign.
        """
        with self._lock:
            self._names, self._statuses = names, dict(statuses)
            self._write, self._stop, self._changed = write, stop, changed

    def close(self) -> None:
        """Refuse all requests, and write nothing to the journal, from now on."""
        with self._lock:
            self._write = self._early = None

    def record(self, kind: str, **details: Any) -> None:
        """Write an entry to the journal, while no request of an operator is being written.

        Before `open` and after `close` nothing is written. Nothing is written either if another
        thread keeps the desk locked for 5 s, as when the disk hangs, so that the calling thread
        does not hang as well.
        """
        if not self._lock.acquire(timeout=_PATIENCE_S):
            return
        try:
            if self._write is not None:
                self._write(kind, **details)
        finally:
            self._lock.release()

    def begins(self, index: int, control: "RunningControl") -> None:
        """Note that the test with an index begins, with its control, and reset `interruption`."""
        with self._lock:
            self._present, self.interruption = index, None
            self._control = control

    def enters(self, phase: str) -> None:
        """Note the phase that the present test enters."""
        with self._lock:
            self._phase = phase

    def ends(self, index: int, status: str, *, attention: bool) -> None:
        """Note how a test ended, and whether an operator should look at it.

        Args:
            index: index of the test.
            status: how the test ended.
            attention: whether it is listed as wanting attention, until an operator acknowledges.
        """
        with self._lock:
            self._present, self._last, self._phase = None, index, ""
            self._control = None
            self._statuses[index] = status
            if attention:
                self._attention.append(f"{self._names[index]}: {status}")

    def held_by(self, reasons: Sequence[str]) -> None:
        """Note the reasons why conditions hold the campaign; empty if it is not held.

        When a hold begins, its reasons are added to what wants attention. If the reasons differ
        from those before, `changed` of `open` is called.
        """
        with self._lock:
            if reasons and not self._held:
                self._attention += reasons
            changed, self._held = list(reasons) != list(self._held), reasons
        if changed:
            self._changed(self.paused, self._held)

    def take_notes(self) -> list[str]:
        """Return the operators' notes since the last call, and forget them: "OPERATOR: TEXT" each.

        The texts of other requests but SET are among them, as "OPERATOR: REQUEST: TEXT".
        """
        with self._lock:
            notes, self._notes = self._notes, []
        return notes

    def take_control_changes(self, time_s: float) -> "list[ControlChange]":
        """Return the changes of the running test's control that are due at a time of it, s.

        They are in their order, and forgotten.
        """
        with self._lock:
            return [] if self._control is None else self._control.take(time_s)

    @property
    def next_control_change_s(self) -> float:
        """The time at which the running test's file changes its control next, s; inf if never."""
        with self._lock:
            return inf if self._control is None else self._control.next_s

    # -- operators --------------------------------------------------------------------------------

    def ask(
        self, request: Request, who: str, text: str = "", test: str = "", person: str = ""
    ) -> str:
        """Take an operator's request, and return an answer that says what will happen.

        The request is written to the journal first. Control characters of its text become spaces,
        so that the text stays on one line. STATUS is refused here; `status` answers it.

        Args:
            request: what the operator asks for.
            who: name of the operator.
            text: the text of a note, or what a SET sets (`rig.configuration.ordered_control`); any
                other request may have one, too; at most `LONGEST_TEXT` characters.
            test: name of the test to skip or retry. If empty, it is the test that runs; if none
                runs, RETRY means the test that ended last, and SKIP is refused.
            person: name of who made the request, if `who` is a program or a key that several people
                use, such as the console's; the text may begin with it.

        Raises:
            RefusedError: the request cannot be carried out, and nothing was written. ABORT is
                carried out even if the journal cannot be written.
        """
        _check(text, "text", LONGEST_TEXT)
        _check(test, "test's name", LONGEST_TEST)
        text = "".join(sign if sign.isprintable() else " " for sign in text)
        who = who.encode(errors="replace").decode()
        person = " ".join(person.encode(errors="replace").decode().split())[:LONGEST_PERSON]
        with self._lock:
            if self._write is None:
                return self._ask_early(request, who, text, person)
            index = self._index(request, test) if request in (Request.SKIP, Request.RETRY) else None
            change = None
            if request is Request.SET:
                change, reply = self._checked_change(person or who, text)
            else:
                reply = self._checked(request, text, index)
            details: dict[str, Any] = {"person": person} if person else {}
            details |= {"text": text} if text else {}
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
            self._obey(request, person or who, remark_of(text, person), index)
            if change is not None and self._control is not None:
                self._control.add(change)
        if request in (Request.PAUSE, Request.RESUME):
            self._changed(self.paused, self._held)
        return reply

    def _ask_early(self, request: Request, who: str, text: str, person: str) -> str:
        """Take an ABORT before `open`; return the answer.

        Raises:
            RefusedError: it is another request, or `prepare` was not called or `close` was.
        """
        if self._early is None or request is not Request.ABORT:
            raise RefusedError("the campaign is not running")
        details = {"request": str(request), "who": who, "person": person, "text": text}
        self._early.append(("operator", {key: each for key, each in details.items() if each}))
        self._obey(request, person or who, remark_of(text, person), None)
        return self._checked(request, text, None)

    def status(self) -> dict[str, Any]:
        """Return the state of the campaign as JSON-able values.

        They are the state ("running", "between tests", "paused", "held" or "ended"), whether a
        pause is asked for, the reasons for a hold, the present test, its phase and its control, the
        number of tests, the status of each test that has ended, and what wants attention.
        """
        with self._lock:
            state = "running" if self._present is not None else "between tests"
            if self._present is None and (self.paused or self._held):
                state = "paused" if self.paused else "held"
            return {
                "state": state if self._write is not None else "ended",
                "pausing": self.paused,
                "held": list(self._held),
                "test": None if self._present is None else self._names[self._present],
                "phase": self._phase,
                "control": "" if self._control is None else str(self._control),
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
        """Return the answer to a request, which is not carried out yet.

        Raises:
            RefusedError: the request cannot be carried out now.
        """
        name = "" if index is None else self._names[index]
        running = index is not None and index == self._present
        match request:
            case Request.PAUSE:
                after = "" if self._present is None else f" after {self._names[self._present]}"
                return f"pauses{after}; go on with resume"
            case Request.RESUME if not self.paused:
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

    def _checked_change(self, who: str, text: str) -> "tuple[ControlChange, str]":
        """Return the change of control that a SET asks for, and the answer; nothing changes yet.

        Raises:
            RefusedError: no test runs, or the change is refused.
        """
        if self._control is None or self._present is None or self._phase == "cleanup":
            raise RefusedError("no test runs whose control could be set")
        change, judged = self._control.asked(who, text)
        return change, f"sets {change} in {self._names[self._present]} without a bump; {judged}"

    def _obey(self, request: Request, who: str, text: str, index: int | None) -> None:
        running = index is not None and index == self._present
        # What came of a SET is an event of its own in the recording.
        if text and request is not Request.SET:
            self._notes.append(
                f"{who}: {text if request is Request.NOTE else f'{request}: {text}'}"
            )
        match request:
            case Request.PAUSE | Request.RESUME:
                self.paused = request is Request.PAUSE
                self.paused_by = who if self.paused else ""
            case Request.ABORT:
                self._stop.request(f"{who}: {text}" if text else who)
            case Request.ACKNOWLEDGE:
                self._attention.clear()
            case Request.SKIP | Request.RETRY if running:
                self.interruption = request
            case Request.RETRY if index is not None:
                del self._statuses[index]


def _check(text: str, what: str, longest: int) -> None:
    """Check that a text can be encoded in UTF-8 and is not too long.

    Args:
        text: the text.
        what: what the text is, for the message.
        longest: most characters that it may have.

    Raises:
        RefusedError: the text cannot be encoded, or is too long.
    """
    if len(text) > longest:
        raise RefusedError(f"a {what} of {len(text)} characters; at most {longest}")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise RefusedError(f"a {what} that is no UTF-8") from None
