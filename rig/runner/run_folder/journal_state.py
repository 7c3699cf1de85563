"""Derives the state of a campaign from its journal: finished tests, attempts, and requests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

from rig.runner.outcomes import Attempt, Happening, Status, TestOutcome, outcome_of

from .journal import Entry

CAMPAIGN: Final = "campaign"
"""Name in place of an operator's for events that no operator asked for."""


@dataclass
class JournalState:
    """The state of a campaign according to its journal; `take` updates it entry by entry.

    Attributes:
        tests: names of the campaign's tests.
        begun: the entry `begin`; None before it.
        finished: outcomes of the tests that are finished, by the test's index.
        attempts: earlier runs of a test that was run again, by the test's index, oldest first.
        skipped: indices of the tests that an operator has asked to skip and that have had no
            outcome since.
        history: what happened outside the tests, oldest first: operators' requests, holds,
            resumptions, refused requests, drives by another master, and a stop.
    """

    tests: Sequence[str] = ()
    begun: Entry | None = None
    finished: dict[int, TestOutcome] = field(default_factory=dict)
    attempts: dict[int, list[Attempt]] = field(default_factory=dict)
    skipped: set[int] = field(default_factory=set)
    history: list[Happening] = field(default_factory=list)
    _open: dict[int, tuple[Attempt, TestOutcome | None]] = field(default_factory=dict)
    """Latest attempt of each test that is not finished; moved to `attempts` when it runs again.

    Its outcome is None after a kill."""
    _present: int | None = None
    _phase: str = ""
    _at: str = ""
    _recording: str | None = None

    def take(self, entry: Entry) -> None:
        """Update the state by the next entry of the journal.

        An entry of an unknown kind changes nothing.

        Raises:
            KeyError, TypeError, ValueError: the entry does not belong to a campaign's journal.
        """
        match entry.kind:
            case "begin":
                self.begun, self.tests = entry, tuple(entry["tests"])
            case "resume":
                self._interrupted(entry)
            case "phase":
                self._enters(entry)
            case "outcome":
                self._ends(entry["test"], outcome_of(entry["outcome"]))
            case "operator":
                self._asked(entry)
            case "held":
                self._happened(entry, CAMPAIGN, f"held: {'; '.join(entry['reasons'])}")
            case "released":
                self._happened(entry, CAMPAIGN, f"goes on after {entry['after_s']:.0f} s")
            case "refused":
                self._happened(entry, CAMPAIGN, f"refused a request: {entry['why']}")
            case "driven":
                self._happened(entry, CAMPAIGN, entry["what"])
            case "overdue":
                name = "" if self._present is None else f" {self.tests[self._present]}"
                what = f"cleaning up after{name} took too long; ended at once"
                self._happened(entry, CAMPAIGN, what)
            case "end" if entry["reason"]:
                self._happened(entry, CAMPAIGN, f"stopped by {entry['reason']}")

    @property
    def where(self) -> str:
        """Name and phase of the test that runs, "NAME, PHASE"; empty if none runs."""
        return "" if self._present is None else f"{self.tests[self._present]}, {self._phase}"

    @property
    def recording(self) -> str | None:
        """File name of the recording of the test that runs; None if there is no recording yet."""
        return None if self._present is None else self._recording

    def number_of(self, index: int) -> int:
        """Return the number of a test's next attempt, from 1."""
        return len(self.attempts.get(index, [])) + (index in self._open) + 1

    def outcome(self, index: int, not_run: TestOutcome) -> TestOutcome:
        """Return the outcome of a test's latest ended attempt, also one that does not count.

        A latest attempt that a kill ended gets the status `interrupted`; earlier attempts are
        listed in `attempts`.

        Args:
            index: of the test.
            not_run: the outcome to return if no attempt has ended, or if a further one runs now.
        """
        known = self.finished.get(index)
        if known is None and index in self._open:
            last, known = self._open[index]
            known = known or replace(
                not_run, status=last.status, message=last.message, recording=last.recording
            )
        return replace(known or not_run, attempts=tuple(self.attempts.get(index, ())))

    def _enters(self, entry: Entry) -> None:
        index = entry["test"]
        if entry["phase"] == "setup":
            last, _ = self._open.pop(index, (None, None))
            if last is not None:
                kept = replace(last, recording=entry["kept"])
                self.attempts.setdefault(index, []).append(kept)
            self._present, self._at, self._recording = index, entry.at, None
        self._phase = entry["phase"]
        self._recording = entry["recording"] or self._recording

    def _ends(self, index: int, outcome: TestOutcome) -> None:
        self.skipped.discard(index)
        if outcome.is_finished:
            self._open.pop(index, None)
            self.finished[index] = outcome
        else:
            self._leave_open(index, outcome.status, outcome.message, outcome.recording, outcome)
        self._present = None

    def _leave_open(
        self,
        index: int,
        status: Status,
        message: str,
        recording: str | None,
        outcome: TestOutcome | None = None,
    ) -> None:
        phase = self._phase if index == self._present else ""
        number = self.number_of(index)
        self._open[index] = Attempt(number, status, phase, message, self._at, recording), outcome

    def _interrupted(self, entry: Entry) -> None:
        """Note that the campaign is resumed; a test without an outcome counts as killed."""
        what = "resumed"
        if self._present is not None:
            index, phase = self._present, self._phase
            what += f" after a kill in {self.where}"
            message = f"killed in the phase {phase}"
            self._leave_open(index, Status.INTERRUPTED, message, self._recording)
            self._present = None
        if entry["versions_changed"]:
            what += f"; other versions: {entry['versions_changed']}"
        self._happened(entry, CAMPAIGN, what)

    def _asked(self, entry: Entry) -> None:
        request, text, index = entry["request"], entry["text"] or "", entry["test"]
        if request == "skip":
            self.skipped.add(index)
        if request == "retry" and index in self.finished:
            last = self.finished.pop(index)
            self._leave_open(index, last.status, last.message, last.recording, last)
        words = (
            "" if request == "note" else request,
            "" if index is None else self.tests[index],
            "; ".join(entry["seen"] or ()),
        )
        sentence = " ".join(filter(None, words))
        self._happened(entry, entry["who"], ": ".join(filter(None, (sentence, text))))

    def _happened(self, entry: Entry, who: str, what: str) -> None:
        self.history.append(Happening(entry.at, who, what))


def standing_of(entries: Sequence[Entry]) -> JournalState:
    """Return the state of a campaign after all entries of its journal.

    Raises:
        KeyError, TypeError, ValueError: the entries are not those of a campaign's journal.
    """
    state = JournalState()
    for entry in entries:
        state.take(entry)
    return state


def stands_unfinished(standing: JournalState) -> bool:
    """Return whether a campaign was begun and has tests that are not finished."""
    return standing.begun is not None and len(standing.finished) < len(standing.tests)


def changes_of(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return the values that differ, such as versions, as "NAME OLD -> NEW" each.

    An entry of `old` that `new` lacks is left out; one that `old` lacks is "None".
    """
    return [
        f"{name} {old.get(name)} -> {value}"
        for name, value in new.items()
        if old.get(name) != value
    ]
