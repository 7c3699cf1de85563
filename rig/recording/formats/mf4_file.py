"""MF4 files (ASAM MDF 4.10) for measurement tools are written here; this needs the extra `mf4`."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import numpy as np

from rig.recording.errors import RecordingError
from rig.recording.recording import Recording
from rig.recording.units import unit_of

_VERSION: Final = "4.10"
"""A version that every reader of MDF 4 understands."""
_LATEST_NS: Final = 2**63
"""From this on a time, ns since 1970, does not fit into the file's 64 bits: the year 2262."""


def write_mf4(recording: Recording, path: Path, name: str) -> None:
    """Write a recording to an MF4 file, as one channel group with `time_s` as its master channel.

    float64 values are stored bit for bit, with units; metadata and events are in the file's
    comment, as JSON. The file's start time is that of the recording, by its metadata `start_ns`
    (ns since 1970); without that it is the beginning of 1970, by which no reader is misled.

    Args:
        recording: the recording to write.
        path: the file to write.
        name: the file's name in messages.

    Raises:
        RecordingError: asammdf is not installed.
    """
    try:
        from asammdf import MDF, Signal
    except ImportError:
        value = "asammdf is not installed"
        remedy = "pip install 'hydraulic-rig[mf4]', or choose .parquet or .csv"
        raise RecordingError.of_file(name, value, remedy, "MF4 needs it") from None
    signals = [
        Signal(np.ascontiguousarray(values), recording.time_s, name=channel, unit=unit_of(channel))
        for channel, values in recording.channels.items()
        if channel != "time_s"
    ]
    comment = {"metadata": recording.metadata, "events": recording.events}
    # asammdf appends a suffix of its own to any other name.
    written = path.with_suffix(".mf4")
    try:
        with MDF(version=_VERSION) as file:
            file.append(signals, comment="rig", common_timebase=True)
            file.header.comment = json.dumps(comment)
            file.header.start_time = _started(recording)
            file.save(written, overwrite=True, compression=2)
        written.replace(path)
    finally:
        written.unlink(missing_ok=True)


def _started(recording: Recording) -> datetime:
    """Return when the recording began, by its metadata; the beginning of 1970 if that is unknown.

    asammdf's own default is the time of the export.
    """
    start_ns = recording.metadata.get("start_ns")
    if not isinstance(start_ns, int) or not 0 < start_ns < _LATEST_NS:
        start_ns = 0
    return datetime.fromtimestamp(1e-9 * start_ns, UTC)
