"""Recordings of any format are read here; one that a filter cannot use is refused with reasons."""

import difflib
import json
import stat
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Final

import numpy as np

from rig.unique_keys import RepeatedLineError, json_of

from . import formats
from .bounds import LARGEST_JSON, read_bounded
from .errors import RecordingError
from .interpolation import without_interpolated
from .recording import REPLAY_CHANNELS, Recording, Table, events_from
from .sampling import LONGEST_S, SAMPLE_PERIOD_S, Sampling, on_grid, sampling_of
from .validation import problems_of

EXTENSIONS: Final = (".mcap", ".csv", ".csv.gz", ".parquet")
LONGEST_OF_RIG_S: Final = 0.1
"""Longest period, s, of recordings of the servo-hydraulic rig; with times in ms it seems longer."""
SIDECAR: Final = ".json"
"""Suffix to a CSV file's name; the file of that name holds the CSV's metadata and events."""


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a file: its name, and the factor from its unit to the channel's SI unit."""

    name: str
    factor: float = 1.0


def extension_of(path: str) -> str | None:
    """Return the one of EXTENSIONS with which a file name ends, in upper or lower case, or None."""
    lowered = path.lower()
    return next((end for end in EXTENSIONS if lowered.endswith(end)), None)


def read_recording(
    path: str | PathLike[str], *, required: Sequence[str] = REPLAY_CHANNELS
) -> Recording:
    """Return the recording in a .mcap, .csv, .csv.gz or .parquet file, after checking it.

    Required channels must have a finite value in every row, except where the loop recorded that a
    measured sample is missing. In other channels NaN (in CSV an empty cell) is a missing sample.
    Samples must be 1 ms apart within 1 %, without gaps, for 1 s at least. Values that no
    servo-hydraulic rig shows, as in a wrong unit, are refused. A CSV's metadata and
    events come from `NAME.json` beside it; if that describes other data, it is ignored with a
    warning.

    Args:
        path: the file.
        required: channels that the file must have, beside `time_s`.

    Raises:
        RecordingError: lists every problem of the file, each with remedy and, if it has one, line;
            that it is damaged, or too large for this machine's memory, is one too.
    """
    return _checked(fspath(path), required, None, of_rig=True, longest_s=None)


def read_measured(
    path: str | PathLike[str],
    *,
    held: Sequence[str] = ("command_V",),
    measured: Sequence[str] = ("position_m", "pressure_1_Pa", "pressure_2_Pa"),
    optional: Sequence[str] = (),
    period: float = SAMPLE_PERIOD_S,
    columns: Mapping[str, Column] | None = None,
    of_rig: bool = True,
) -> Recording:
    """Return the recording in a file of any period, with gaps, as samples of one period.

    Rows may be 0.1 ms to 1 s apart (0.1 s at most if `of_rig`), uneven, and with gaps of 10 minutes
    at most; `on_grid` makes samples of them. NaN is a missing value in any channel. Rows of a
    channel that are no readings, because it was sampled more slowly and interpolated, become NaN
    too. `Recording.sampling` says what was found. Formats, and metadata and events of a CSV, are as
    with `read_recording`.

    Args:
        path: the file.
        held: channels that are commanded and act from their row to the next.
        measured: channels that the file must have.
        optional: measured channels that it may have; one that it lacks is NaN throughout.
        period: period of the samples, s.
        columns: channel -> column of the file, for channels that have another name or unit there.
        of_rig: whether values that no servo-hydraulic rig shows, as in a wrong unit, are refused.

    Raises:
        RecordingError: lists every problem of the file, each with remedy and, if it has one, line.
    """
    longest = LONGEST_OF_RIG_S if of_rig else LONGEST_S
    rows = _checked(fspath(path), (*held, *measured), columns, of_rig, longest)
    tried = [name for name in (*measured, *optional) if name in rows]
    channels, interpolated = without_interpolated(rows.channels, tried)
    lacking = tuple(name for name in optional if name not in rows)
    channels |= {name: np.full(len(rows), np.nan) for name in lacking}
    recording = on_grid(replace(rows, channels=channels), period, held)
    assert recording.sampling is not None
    unrecorded = tuple(name for name in optional if not np.isfinite(channels[name]).any())
    noted = replace(recording.sampling, interpolated=interpolated, unrecorded=unrecorded)
    return replace(recording, sampling=noted)


def read_sampling(
    path: str | PathLike[str], columns: Mapping[str, Column] | None = None
) -> Sampling | None:
    """Return how a file's rows are sampled; None if the file cannot be read as a recording.

    `read_measured` raises an error that says what is wrong with such a file.

    Args:
        path: the file.
        columns: channel -> column of the file, for channels that have another name or unit there.
    """
    try:
        return sampling_of(_checked(fspath(path), (), columns, False, LONGEST_S).time_s)
    except RecordingError:
        return None


def _checked(
    name: str,
    required: Sequence[str],
    columns: Mapping[str, Column] | None,
    of_rig: bool,
    longest_s: float | None,
) -> Recording:
    """Return the rows of a file as a recording, after checking them (`problems_of`).

    Args:
        name: the file.
        required: channels that the file must have, beside `time_s`.
        columns: channel -> column of the file, for channels that have another name or unit there.
        of_rig: whether values that no servo-hydraulic rig shows are refused.
        longest_s: longest period of the rows, s; None if they must be 1 ms apart.

    Raises:
        RecordingError: lists every problem of the file.
    """
    extension = extension_of(name)
    _check_path(name, extension)
    # `formats` loads a format's module, and with it a library, when its name is first used.
    try:
        if extension == ".mcap":
            table = formats.read_mcap(name)
        elif extension == ".parquet":
            table = formats.read_parquet(name)
        else:
            table = formats.read_csv(name)
    except OSError as error:
        remedy = "check that the file can be read"
        raise RecordingError.of_file(name, error.strerror or str(error), remedy) from None
    except MemoryError:
        remedy = "split it, or read it on a machine with more memory"
        raise RecordingError.of_file(name, "takes more memory than is free", remedy) from None
    needed = _named(table, columns or {}, tuple(dict.fromkeys(("time_s", *required))))
    problems = problems_of(table, needed, of_rig=of_rig, longest_s=longest_s)
    if problems:
        raise RecordingError(problems)
    channels = {"time_s": table.columns["time_s"]} | table.columns
    recording = Recording(channels, table.metadata, table.events, name, replayed=table.replayed)
    return _with_sidecar(recording) if extension in (".csv", ".csv.gz") else recording


def _named(table: Table, columns: Mapping[str, Column], needed: Sequence[str]) -> Sequence[str]:
    """Rename and scale a table's columns to channels, in place; return the needed ones to check.

    A problem is added to the table for each needed channel whose column it lacks. These channels
    are left out of the result.

    Args:
        table: the table, which is changed.
        columns: channel -> column of the file, for channels that are named otherwise there.
        needed: channels that the table must have.
    """
    found = {channel: each for channel, each in columns.items() if each.name in table.columns}
    lacking = [channel for channel in columns if channel in needed and channel not in found]
    for channel in lacking:
        value = f"missing column, which is to be {channel}"
        remedy = "name the column of this file where the columns are named"
        limit = f"columns present: {', '.join(table.columns)}"
        table.report(columns[channel].name, value, remedy, limit)
    taken = {*(column.name for column in columns.values()), *lacking}
    scaled = {name: table.columns[column.name] * column.factor for name, column in found.items()}
    unread = {name: table.unread(column.name) for name, column in found.items()}
    table.columns = {name: v for name, v in table.columns.items() if name not in taken} | scaled
    table.unreadable |= unread
    return [name for name in needed if name not in lacking]


def _check_path(path: str, extension: str | None) -> None:
    """Raise unless a path is a file with the extension of a recording.

    Raises:
        RecordingError: the path is no regular file, does not exist, or has another extension.
    """
    file = Path(path)
    try:
        state = file.stat().st_mode if file.exists() else None
    except (OSError, ValueError) as error:
        # A name in the path is too long, may not be looked at, or has a NUL.
        reason = getattr(error, "strerror", None) or str(error)
        raise RecordingError.of_file(path, reason, "check the path") from None
    if state is None:
        raise RecordingError.of_file(path, "does not exist", _nearest_files(file))
    if stat.S_ISDIR(state):
        raise RecordingError.of_file(path, "is a folder", f"give a file, as in {path}/*.mcap")
    if not stat.S_ISREG(state):
        # A device may have no end, and a pipe may never begin.
        raise RecordingError.of_file(path, "is no regular file", "copy it to a file first")
    if extension is None:
        value = f"unknown extension {file.suffix!r}"
        limit = f"recordings are {', '.join(EXTENSIONS)}"
        raise RecordingError.of_file(path, value, "rename or convert the file", limit)


def _nearest_files(file: Path) -> str:
    if not file.parent.is_dir():
        return f"folder {file.parent} does not exist either: check the path"
    names = [entry.name for entry in file.parent.iterdir() if extension_of(entry.name)]
    near = difflib.get_close_matches(file.name, names, n=3)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"check the path; {file.parent} has {len(names)} recordings"


def _with_sidecar(recording: Recording) -> Recording:
    sidecar = Path(recording.source + SIDECAR)
    if not sidecar.exists():
        return recording
    try:
        content = json_of(read_bounded(sidecar, LARGEST_JSON))
        belongs = content["sha256"] == recording.content_hash()
        metadata, events = dict(content["metadata"]), events_from(json.dumps(content["events"]))
    except RepeatedLineError as error:
        place = f"{sidecar}:{error.line}"
        raise RecordingError.of_file(place, str(error), "restore or delete it") from None
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        value, remedy = f"cannot be read ({error!r})", "restore or delete it"
        raise RecordingError.of_file(str(sidecar), value, remedy) from None
    if not belongs:
        warnings.warn(
            f"{sidecar}: describes other data than {recording.source} has now; ignored",
            stacklevel=4,
        )
        return recording
    return Recording(recording.channels, metadata, events, recording.source)
