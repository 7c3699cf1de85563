"""Going on with a campaign that was stopped or killed: by its journal, if nothing has changed.

Tests, rig and model must be the same as in the run before, by their fingerprints.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
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
    """Return the SHA-256 (hex) of campaign, rig and model, by these names.

    A YAML file counts by its meaning, so that a comment in it may change; any other file
    (setpoints, baselines, calibrations) counts by its content.
    """
    files = {
        path: digest
        for path, digest in campaign.source_files.items()
        if Path(path).suffix not in _YAML
    }
    meant = {
        "name": campaign.name,
        "tests": plain(campaign.tests),
        "filter": campaign.filter_name,
        "false_alarms_per_day": campaign.false_alarms_per_day,
        "conditions": plain(campaign.conditions),
        "files": sorted(files.values()),
    }
    return {
        "campaign": _sha256(meant),
        "rig": _sha256(plain(rig)),
        "model": model_sha256(campaign.model),
    }


def changed(kept: Mapping[str, Any], found: Mapping[str, str]) -> list[str]:
    """Return what is not the same any more, by name."""
    return [part for part, digest in found.items() if kept.get(part) != digest]


def _sha256(content: Any) -> str:
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def begun_in(folder: Path) -> Entry:
    """Return what a run's journal says of the campaign it is of.

    Raises:
        JournalError: nothing was begun there.
    """
    entries = read_journal(folder / JOURNAL)
    if not entries or entries[0].kind != "begin":
        raise JournalError(f"{folder}: no campaign was begun in it; run one: rig run CAMPAIGN")
    return entries[0]


def unfinished_run(campaign: str, below: Path) -> Path:
    """Return the newest run of a campaign in the folders below one that has not come to its end.

    Raises:
        JournalError: there is none.
    """
    found = []
    for journal in below.glob(f"*/{JOURNAL}"):
        try:
            standing = standing_of(read_journal(journal))
        except (JournalError, KeyError, TypeError, ValueError, AttributeError):
            continue
        begun = standing.begun
        if begun is not None and begun["campaign"] == campaign and stands_unfinished(standing):
            found.append((begun.at, journal.parent))
    if not found:
        remedy = "give its folder: --out DIR"
        raise JournalError(f"{below}: holds no unfinished run of {campaign}; {remedy}")
    return max(found)[1]


def resumable(entries: Sequence[Entry], folder: Path, campaign: Campaign, rig: Rig) -> JournalState:
    """Return where a campaign stands, to go on with it.

    Args:
        entries: of its journal, at least one.
        folder: of the run.
        campaign: as it is now.
        rig: as it is now.

    Raises:
        JournalError: the journal is not this campaign's, or something has changed since.
    """
    try:
        standing = standing_of(entries)
        begun = standing.begun
        if begun is None:
            raise ValueError("no begin")
        other = changed(begun["fingerprint"], fingerprint(campaign, rig))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise JournalError(f"{folder / JOURNAL}: is not a campaign's journal ({error})") from None
    names = [test.name for test in campaign.tests]
    if begun["campaign"] != campaign.name or (not other and list(standing.tests) != names):
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
    return standing


def learn_again(
    references: HealthyReferences, standing: JournalState, folder: Path, recordings: Sequence[str]
) -> None:
    """Learn again from the recordings of finished healthy tests, for the tests that follow."""
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
    """Put the recording of an earlier attempt aside, whole; return its name, None without one.

    One that a kill has cut is completed as far as it goes.
    """
    kept = attempt_path(recording, number)
    if not recording.exists():
        return kept.name if kept.exists() else None
    try:
        read_mcap(str(recording))
        is_whole = True
    except RecordingError:
        is_whole = False
    if not is_whole and (kept.exists() or _is_recovered(recording, kept)):
        recording.unlink()
    else:
        recording.replace(kept)
    return kept.name


def _is_recovered(recording: Path, kept: Path) -> bool:
    try:
        recover(recording, kept)
    except (RecordingError, OSError):
        return False
    return True
