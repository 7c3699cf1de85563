"""A clean recording is made here from the readable part of a cut or damaged MCAP file."""

from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from . import formats
from .damaged_file import DamagedFile
from .errors import RecordingError, RecordingProblem
from .targets import replacing, target_problems

_HALF_TICK_S: Final = 0.5e-3
"""A row of the overview is that of the sample whose time differs by less than this, s."""


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """A summary of how much of a damaged file was saved, and what was lost.

    Attributes:
        path_in: the damaged file.
        path_out: the file that was written.
        samples_kept: samples that were written.
        samples_dropped: readable samples that were left out, on the other side of a gap.
        first_time_s, last_time_s: times in s of the first and the last sample that were written.
        events_kept: events that were written.
        lost: one sentence on each loss.
    """

    path_in: str
    path_out: str
    samples_kept: int
    samples_dropped: int
    first_time_s: float
    last_time_s: float
    events_kept: int
    lost: tuple[str, ...]

    def __str__(self) -> str:
        """Return a line on the saved part, and a further line for each loss."""
        kept = (
            f"{self.path_out}: {self.samples_kept} samples, {self.first_time_s:.9g} s to "
            f"{self.last_time_s:.9g} s, {self.events_kept} events"
        )
        losses = self.lost or ("nothing was lost",)
        return "\n".join([kept, *(f"{self.path_in}: {loss}" for loss in losses)])


def recover(path_in: str | PathLike[str], path_out: str | PathLike[str]) -> RecoverySummary:
    """Write what can be read of a damaged MCAP file to a new file; return what was saved and lost.

    A filter needs samples without gaps, so that of the stretches into which damage splits the
    recording only the longest is written, with metadata and all events that can be read. Every
    chunk is checked by its checksum. Damaged schemas and channels are taken from their copies at
    the file's end, and of damaged metadata the keys that can be read. The key `recovered` is added
    to the metadata.

    Args:
        path_in: the damaged file, which is not changed.
        path_out: the new file.

    Raises:
        RecordingError: path_out exists, its folder does not, or it does not end with .mcap; or
            path_in does not exist, has no readable sample, is not a recording of rig, or holds more
            than memory can take.
        OSError: a file cannot be read or written.
    """
    source, target = fspath(path_in), fspath(path_out)
    problems = _path_problems(source, target)
    if problems:
        raise RecordingError(problems)
    collector = formats.SampleCollector(source)
    with formats.mapped(source) as file:
        is_of_rig = formats.is_of_rig(file)
        damaged = DamagedFile(file, collector, is_of_rig)
        try:
            stretches, lost = damaged.stretches()
        except formats.ForeignSchemaError as error:
            if not is_of_rig or damaged.has_copies:
                raise formats.foreign(source, str(error)) from None
            value = f"damaged ({error}), and its end holds no whole copy of what is damaged"
            raise RecordingError.of_file(source, value, "record again") from None
    if "time_s" not in collector.channels:
        value = "the topic rig/details is missing, which holds the times of the samples"
        raise RecordingError.of_file(source, value, "record again")
    sizes = [sum(len(block) for block in stretch) for stretch in stretches]
    best = int(np.argmax(sizes))
    if not sizes[best]:
        value = "; ".join(["no sample can be read", *lost])
        raise RecordingError.of_file(source, value, "record again")
    if collector.times.wrong:
        lost.append(
            f"the log times of {collector.times.wrong} messages or chunks contradicted the times "
            f"in the messages, which were kept; {collector.times.first}"
        )
    dropped = sum(sizes) - sizes[best]
    if dropped:
        lost.append(f"{dropped} readable samples on the other side of a gap")
    channels = formats.columns_of(collector.channels, stretches[best])
    if collector.division is not None:
        channels |= _replayed(collector, channels["time_s"])
    metadata = collector.metadata | {"recovered": {"from": Path(source).name, "lost": lost}}
    with replacing(Path(target)) as partial:
        formats.write_mcap(partial, channels, metadata, collector.events, collector.division)
    kept, (first_s, last_s) = sizes[best], channels["time_s"][[0, -1]].tolist()
    events = len(collector.events)
    return RecoverySummary(source, target, kept, dropped, first_s, last_s, events, tuple(lost))


def _replayed(
    collector: formats.SampleCollector, time_s: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return what the overview tells of the channels that a replay makes again, for viewers.

    They are channels of shape (n,), as `time_s`, and NaN where the overview has no row.
    """
    division = collector.division
    assert division is not None
    channels = {name: np.full(len(time_s), np.nan) for name in division.replayed}
    start_ns = int(collector.metadata.get("start_ns", 0))
    for log_times, rows in collector.overview:
        since_s = (log_times.astype(np.int64) - start_ns) * 1e-9
        at = np.minimum(np.searchsorted(time_s, since_s - _HALF_TICK_S), len(time_s) - 1)
        here = np.abs(time_s[at] - since_s) < _HALF_TICK_S
        for name, values in zip(channels, rows.T, strict=False):
            channels[name][at[here]] = values[here]
    return channels


def _path_problems(source: str, target: str) -> list[RecordingProblem]:
    problems = []
    if not Path(source).is_file():
        problems.append(RecordingProblem(source, "file", "is no file", "check the path"))
    if not target.lower().endswith(".mcap"):
        value, limit = "not an MCAP name", "must end with .mcap"
        problems.append(RecordingProblem(target, "file", value, "rename it", limit))
    return problems + target_problems(target, may_replace=False)
