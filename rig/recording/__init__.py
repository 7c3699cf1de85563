"""Reads and writes recordings (MCAP, CSV, Parquet), lossless for whatever a filter consumed.

Channels carry their unit in the name; missing samples are NaN.
"""

from typing import TYPE_CHECKING, Any

from .errors import MAX_PROBLEMS, Problem, RecordingError
from .exporting import export
from .mapping import Column
from .reading import EXTENSIONS, read_recording
from .recording import REPLAY_CHANNELS, Event, Recording, content_hash
from .units import unit_of

if TYPE_CHECKING:
    from .mcap_writer import McapWriter
    from .recovery import RecoverySummary, recover

__all__ = [
    "EXTENSIONS",
    "MAX_PROBLEMS",
    "REPLAY_CHANNELS",
    "Column",
    "Event",
    "McapWriter",
    "Problem",
    "Recording",
    "RecordingError",
    "RecoverySummary",
    "content_hash",
    "export",
    "read_recording",
    "recover",
    "unit_of",
]

# These need the mcap library, which most commands never do.
_ON_DEMAND = {
    "McapWriter": "mcap_writer",
    "RecoverySummary": "recovery",
    "recover": "recovery",
}


def __getattr__(name: str) -> Any:
    if name not in _ON_DEMAND:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_ON_DEMAND[name]}", __name__), name)
