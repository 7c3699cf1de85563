"""Derives the state of a campaign from its journal, and resumes one that was stopped or killed.

The state tells finished tests, attempts, and requests. Fingerprints show that campaign, rig and
model are the same as when the run began; if not, it cannot be resumed.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimator.leaks import STARTED_S
from faults import Campaign
from rig.configuration import Rig, plain
from rig.control_socket import remark_of
from rig.plant import model_sha256
from rig.recording import RecordingError, read_mcap, read_recording, recover
from rig.runner.outcomes import (
    Attempt,
    Happening,
    HealthyReferences,
    Status,
    TestOutcome,
    outcome_of,
    with_estimates,
)

from .directory import RESULTS, attempt_path
from .entry_types import check_types
from .journal import JOURNAL, Entry, JournalError, not_of_a_campaign, read_journal, since_end

CAMPAIGN: Final = "campaign"
"""Name in place of an operator's for events that no operator asked for."""
_INNOVATIONS: Final = ("innovation_pressure_1_Pa", "innovation_pressure_2_Pa")
_ALWAYS: Final = object()
_LATER: Final[dict[str, Any]] = {
    "gain_V_per_m": None, "own_figures": [], "criteria": [], "limits": [],
    "wait_for": [], "until": None,
}  # fmt: skip
_LATER_OF_FAULTS: Final[dict[str, Any]] = {"follows": 0.0, "goes_on": False}
"""Keys of tests and of faults that earlier versions did not have -> the value without effect."""
_YAML: Final = (".yaml", ".yml")


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
        history: what happened outside the tests, oldest first: operators' requests, refused
            requests, begin and end of holds, resumptions after a stop or a kill, devices driven by
            another master, cleaning up that took too long, and a stop.
    """

    tests: Sequence[str] = ()
    begun: Entry | None = None
    finished: dict[int, TestOutcome] = field(default_factory=dict)
    attempts: dict[int, list[Attempt]] = field(default_factory=dict)
    skipped: set[int] = field(default_factory=set)
    history: list[Happening] = field(default_factory=list)
    _open: dict[int, Attempt] = field(default_factory=dict)
    """Latest attempt of each test that is not finished; moved to `attempts` when it runs again."""
    _partial: dict[int, TestOutcome] = field(default_factory=dict)
    """Outcomes of the attempts in `_open`; there is none after a kill."""
    _present: int | None = None
    _phase: str = ""
    _at: str = ""
    _recording: str | None = None

    def take(self, entry: Entry) -> None:
        """Update the state by the next entry of the journal.

        An entry of an unknown kind changes nothing.

        Raises:
            ValueError: the entry does not belong to a campaign's journal.
        """
        match entry.kind:
            case "begin":
                if entry["started"] is not None:
                    datetime.fromisoformat(entry["started"])
                self.begun, self.tests = entry, tuple(entry["tests"])
                if entry["by"]:
                    self._happened(entry, entry["by"], "begun")
            case "resume":
                self._interrupted(entry)
            case "phase":
                self._enters(entry)
            case "outcome":
                self._ends(self._index_in(entry), outcome_of(entry["outcome"]))
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
            case "limit":
                where = "" if self._present is None else f"{self.tests[self._present]}: "
                self._happened(entry, CAMPAIGN, f"limit: {where}{entry['what']}")
            case "control":
                where = self.tests[self._index_in(entry)]
                at_s = entry["at_s"]
                when = "was not changed, as it ended" if at_s is None else f"from {at_s:.3f} s"
                self._happened(entry, entry["who"], f"control of {where} {when}: {entry['what']}")
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
        """File name of the recording of the test that runs.

        It is None if no test runs, or if the recording has not begun.
        """
        return None if self._present is None else self._recording

    def number_of(self, index: int) -> int:
        """Return the number of a test's next attempt, from 1."""
        return len(self.attempts.get(index, [])) + (index in self._open) + 1

    def outcome(self, index: int, not_run: TestOutcome) -> TestOutcome:
        """Return the outcome of a test's latest attempt, whether the test is finished by it or not.

        If a kill ended this attempt, the outcome is `not_run` with the status `interrupted`, and
        with message and recording of the attempt. The `attempts` of the outcome are always the
        test's earlier attempts.

        Args:
            index: index of the test.
            not_run: the outcome to return if no attempt has ended, or if a further one runs now.
        """
        known = self.finished.get(index) or self._partial.get(index)
        if known is None and index in self._open:
            last = self._open[index]
            known = replace(
                not_run, status=last.status, message=last.message, recording=last.recording
            )
        return replace(known or not_run, attempts=tuple(self.attempts.get(index, ())))

    def _index_in(self, entry: Entry) -> int:
        """Return the index of the test that an entry is about.

        Raises:
            ValueError: the campaign has no such test.
        """
        index: int = entry["test"]
        if type(index) is not int or not 0 <= index < len(self.tests):
            raise ValueError(f"the test {index!a} of {len(self.tests)}")
        return index

    def _enters(self, entry: Entry) -> None:
        index = self._index_in(entry)
        if entry["phase"] == "setup":
            last = self._open.pop(index, None)
            self._partial.pop(index, None)
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
            self._partial.pop(index, None)
            self.finished[index] = outcome
        else:
            self._leave_open(index, outcome.status, outcome.message, outcome.recording)
            self._partial[index] = outcome
        self._present = None

    def _leave_open(self, index: int, status: Status, message: str, recording: str | None) -> None:
        number = self.number_of(index)
        phase = self._phase if index == self._present else ""
        self._open[index] = Attempt(number, status, phase, message, self._at, recording)

    def _interrupted(self, entry: Entry) -> None:
        """Note that the campaign is resumed; a test that had not ended is noted as killed."""
        what = "resumed"
        if self._present is not None:
            index, phase = self._present, self._phase
            what += f" after a kill in {self.where}"
            message = f"killed in the phase {phase}"
            self._leave_open(index, Status.INTERRUPTED, message, self._recording)
            self._present = None
        if entry["versions_changed"]:
            what += f"; other versions: {entry['versions_changed']}"
        self._happened(entry, entry["by"] or CAMPAIGN, what)

    def _asked(self, entry: Entry) -> None:
        request, text = entry["request"], entry["text"] or ""
        index = None if entry["test"] is None else self._index_in(entry)
        if request == "skip" and index is not None:
            self.skipped.add(index)
        if request == "retry" and index is not None and index in self.finished:
            last = self._partial[index] = self.finished.pop(index)
            self._leave_open(index, last.status, last.message, last.recording)
        words = (
            "" if request == "note" else request,
            "" if index is None else self.tests[index],
            "; ".join(entry["seen"] or ()),
        )
        sentence = " ".join(filter(None, words))
        person = entry["person"] or ""
        remark = remark_of(text, person)
        self._happened(entry, person or entry["who"], ": ".join(filter(None, (sentence, remark))))

    def _happened(self, entry: Entry, who: str, what: str) -> None:
        # A run is begun, or gone on with, before what it runs is compiled and its entry is written.
        self.history.append(Happening(entry["started"] or entry.at, who, what))


def standing_of(entries: Sequence[Entry]) -> JournalState:
    """Return the state of a campaign after all entries of its journal.

    Raises:
        ValueError: the entries are not those of a campaign's journal.
    """
    state = JournalState()
    for entry in entries:
        check_types(entry)
        state.take(entry)
    return state


def changes_of(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return the values that differ, such as versions, as "NAME OLD -> NEW" each.

    A name that only `old` has is left out; for one that only `new` has, OLD is "None".
    """
    return [
        f"{name} {old.get(name)} -> {value}"
        for name, value in new.items()
        if old.get(name) != value
    ]


def fingerprint(campaign: Campaign, rig: Rig) -> dict[str, str]:
    """Return the SHA-256 (hex) of campaign, rig and model, under these three keys.

    YAML files are hashed by the values read from them, so that a change of a comment does not
    matter; other files (setpoints, baselines, calibrations) are hashed by their content.
    """
    sources = campaign.source_files.items()
    meant = {
        "name": campaign.name,
        "tests": [_meant(test) for test in plain(campaign.tests)],
        "filter": campaign.filter_name,
        "false_alarms_per_day": campaign.false_alarms_per_day,
        "conditions": plain(campaign.conditions),
        "files": sorted(digest for path, digest in sources if Path(path).suffix not in _YAML),
    }
    return {
        "campaign": _sha256(meant),
        "rig": _sha256(plain(rig)),
        "model": model_sha256(campaign.model),
    }


def _meant(test: Mapping[str, Any]) -> dict[str, Any]:
    """Return a test without the keys that came later and have no effect as they are.

    So a campaign that an earlier version began can still be resumed.
    """
    kept = {key: value for key, value in test.items() if _LATER.get(key, _ALWAYS) != value}
    kept["faults"] = [
        {key: value for key, value in fault.items() if _LATER_OF_FAULTS.get(key, _ALWAYS) != value}
        for fault in test["faults"]
    ]
    return kept


def _sha256(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def acknowledged(folder: Path) -> Sequence[Happening]:
    """Return who has acknowledged a run after its end, when, and with which words.

    The oldest comes first; it is empty if the journal is gone or damaged.
    """
    try:
        entries = read_journal(folder / JOURNAL)
        count = len(since_end(entries))
        return standing_of(entries).history[-count:] if count else ()
    except ValueError:
        return ()


def begun_in(folder: Path) -> Entry:
    """Return the entry `begin` of the journal in a run's folder.

    Raises:
        JournalError: the journal cannot be read, or no campaign was begun in the folder.
    """
    entries = read_journal(folder / JOURNAL)
    if not entries or entries[0].kind != "begin":
        raise JournalError(f"{folder}: no campaign was begun in it; run one: rig run CAMPAIGN")
    try:
        check_types(entries[0])
    except ValueError as error:
        raise not_of_a_campaign(folder, error) from None
    return entries[0]


def unfinished_run(campaign: str, below: Path) -> Path:
    """Return the folder of the newest unfinished run of a campaign, directly below another folder.

    The newest is the one that was begun last; folders with unreadable journals are passed over.

    Args:
        campaign: name of the campaign.
        below: the folder whose folders are searched.

    Raises:
        JournalError: there is no unfinished run of the campaign.
    """
    found = []
    for journal in below.glob(f"*/{JOURNAL}"):
        try:
            state = standing_of(read_journal(journal))
        except ValueError:
            continue
        begun, is_unfinished = state.begun, len(state.finished) < len(state.tests)
        if begun is not None and begun["campaign"] == campaign and is_unfinished:
            found.append((begun.at, journal.parent))
    if not found:
        remedy = "give its folder: --out DIR"
        raise JournalError(f"{below}: holds no unfinished run of {campaign}; {remedy}")
    return max(found)[1]


def require_journal(folder: Path, recordings: Sequence[str]) -> None:
    """Check that a run which has results or recordings also has a journal to be resumed from.

    Without what the journal says of finished tests, their results would be lost, and the ram moved
    for them again.

    Args:
        folder: folder of the run.
        recordings: file names of its tests' recordings.

    Raises:
        JournalError: the folder holds results or recordings, and a journal that says nothing.
    """
    journal = folder / JOURNAL
    if journal.is_file() and read_journal(journal):
        return
    for name in (RESULTS, *recordings):
        if (folder / name).exists():
            raise JournalError(
                f"{journal}: is {'empty' if journal.exists() else 'gone'}, while {name} is there; "
                "put the journal back from a copy, or run anew with another --out"
            )


def check_journal(folder: Path) -> None:
    """Check that the journal of a run that has results is there, whole, and a campaign's.

    Raises:
        JournalError: it is not, so that the run could not be resumed.
    """
    require_journal(folder, ())
    entries = read_journal(folder / JOURNAL)
    try:
        if standing_of(entries).begun is None:
            raise ValueError("no begin")
    except ValueError as error:
        raise not_of_a_campaign(folder, error) from None


def resumable(entries: Sequence[Entry], folder: Path, campaign: Campaign, rig: Rig) -> JournalState:
    """Return the state from which a campaign can be resumed.

    Args:
        entries: the entries of the campaign's journal, at least one.
        folder: folder of the run, for messages.
        campaign: the campaign as it is configured now.
        rig: the rig as it is configured now.

    Raises:
        JournalError: the journal is not that of this campaign, or campaign, rig or model have
            changed since the run began.
    """
    try:
        state = standing_of(entries)
        begun = state.begun
        if begun is None:
            raise ValueError("no begin")
    except ValueError as error:
        raise not_of_a_campaign(folder, error) from None
    known, now = begun["fingerprint"] or {}, fingerprint(campaign, rig)
    other = [part for part, digest in now.items() if known.get(part) != digest]
    names = [test.name for test in campaign.tests]
    if begun["campaign"] != campaign.name or (not other and list(state.tests) != names):
        raise JournalError(
            f"{folder}: holds a run of the campaign {begun['campaign']}, not of {campaign.name}; "
            "give another --out"
        )
    if other:
        raise JournalError(
            f"{folder}: {' and '.join(other)} changed since the run began ({begun.at}), so that "
            "its tests would not belong together; put back what it was, or run anew with "
            "another --out"
        )
    return state


def learn_again(
    references: HealthyReferences, standing: JournalState, folder: Path, recordings: Sequence[str]
) -> None:
    """Read the innovations of finished healthy tests from recordings, and add them to `references`.

    Only tests that passed or failed and from which others may learn are taken, and of each the
    first 2 s, the filter's start, are left out. Tests that are run after a resumption then learn
    from the same tests as without a stop. A recording that cannot be read is passed over.

    Args:
        references: is updated in place.
        standing: state of the campaign.
        folder: folder of the run.
        recordings: file name of each test's recording, by the test's index.
    """
    tests = references.campaign.tests
    for index in references.running_order:
        outcome = standing.finished.get(index)
        if not references.is_reference(tests[index]) or outcome is None:
            continue
        if outcome.status not in (Status.PASSED, Status.FAILED):
            continue
        try:
            recording = with_estimates(read_recording(folder / recordings[index]))
            innovations = [recording[name] for name in _INNOVATIONS]
        except (RecordingError, KeyError):
            continue
        started = recording.time_s > STARTED_S
        references.add(tests[index], np.column_stack(innovations)[started])


def keep_attempt(recording: Path, number: int) -> str | None:
    """Rename the recording of an earlier attempt, and return its new file name.

    If a kill has cut the recording, it is replaced by a repaired copy with all its complete data;
    if it cannot be repaired, it is renamed as it is. If it was renamed by an earlier call, that
    name is returned; if there is no recording, None.

    Args:
        recording: path of the recording.
        number: number of the attempt, from 1.

    Raises:
        OSError: a file cannot be read, renamed or removed. Nothing is lost, and another call goes
            on from there.
    """
    kept = attempt_path(recording, number)
    if not recording.exists():
        return kept.name if kept.exists() else None
    try:
        read_mcap(str(recording))
        is_replaced = False
    except RecordingError:
        is_replaced = kept.exists()
        if not is_replaced:
            with suppress(RecordingError, OSError):
                recover(recording, kept)
                is_replaced = True
    if is_replaced:
        recording.unlink()
    else:
        recording.replace(kept)
    return kept.name
