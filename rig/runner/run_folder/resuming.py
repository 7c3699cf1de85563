"""Resumes a campaign that was stopped or killed, by its journal.

Fingerprints show that campaign, rig and model are the same as when the run began; if not, it cannot
be resumed.
"""

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from estimator.leaks import STARTED_S
from faults import Campaign
from rig.configuration import Rig, plain
from rig.recording import RecordingError, read_mcap, read_recording, recover
from rig.runner.outcomes import HealthyReferences, Status, model_sha256

from .directory import attempt_path
from .journal import JOURNAL, Entry, JournalError, read_journal
from .journal_state import JournalState, standing_of, stands_unfinished

_INNOVATIONS: Final = ("innovation_pressure_1_Pa", "innovation_pressure_2_Pa")
_YAML: Final = (".yaml", ".yml")


def fingerprint(campaign: Campaign, rig: Rig) -> dict[str, str]:
    """Return the SHA-256 (hex) of campaign, rig and model, under these three keys.

    YAML files are hashed by the values read from them, so that a change of a comment does not
    matter; other files (setpoints, baselines, calibrations) are hashed by their content.
    """
    sources = campaign.source_files.items()
    meant = {
        "name": campaign.name,
        "tests": plain(campaign.tests),
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


def _sha256(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def begun_in(folder: Path) -> Entry:
    """Return the entry `begin` of the journal in a run's folder.

    Raises:
        JournalError: the journal cannot be read, or no campaign was begun in the folder.
    """
    entries = read_journal(folder / JOURNAL)
    if not entries or entries[0].kind != "begin":
        raise JournalError(f"{folder}: no campaign was begun in it; run one: rig run CAMPAIGN")
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
        except (JournalError, KeyError, TypeError, ValueError, AttributeError):
            continue
        begun = state.begun
        if begun is not None and begun["campaign"] == campaign and stands_unfinished(state):
            found.append((begun.at, journal.parent))
    if not found:
        remedy = "give its folder: --out DIR"
        raise JournalError(f"{below}: holds no unfinished run of {campaign}; {remedy}")
    return max(found)[1]


def resumable(entries: Sequence[Entry], folder: Path, campaign: Campaign, rig: Rig) -> JournalState:
    """Return the state from which a campaign can be resumed.

    Args:
        entries: the entries of its journal, at least one.
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
        known, now = begun["fingerprint"], fingerprint(campaign, rig)
        other = [part for part, digest in now.items() if known.get(part) != digest]
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise JournalError(f"{folder / JOURNAL}: is not a campaign's journal ({error})") from None
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
    """Add the innovations in the recordings of finished healthy tests to `references`.

    They are those of tests to learn from that passed or failed, without the filter's start. Tests
    that are run after a resumption then learn from the same tests as without a stop. A recording
    that cannot be read is passed over.

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
            recording = read_recording(folder / recordings[index])
            innovations = [recording[name] for name in _INNOVATIONS]
        except (RecordingError, KeyError):
            continue
        started = recording.time_s > STARTED_S
        references.add(tests[index], np.column_stack(innovations)[started])


def keep_attempt(recording: Path, number: int) -> str | None:
    """Rename the recording of an earlier attempt, and return its new name; None if there is none.

    If a kill has cut the recording, it is replaced by a repaired copy with all its complete data;
    if it cannot be repaired, it is renamed as it is.

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
