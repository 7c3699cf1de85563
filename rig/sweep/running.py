"""Runs the unfinished chunks of a sweep, and writes each result to its folder at once."""

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Final

from rig.configuration import Sweep
from rig.lanes import LANES

from .adaptive import AdaptiveDrawing
from .asked import columns_told
from .drawing import Cases, draw
from .folder import SweepFolder
from .group import Setting, SweepError, setting_of
from .local import Chunks, Stopped
from .run_cases import Judged, sources
from .table import rows_of

Runner = Callable[[Chunks, Setting, Stopped], Iterator[Judged]]
"""A function that runs chunks, here or elsewhere, and yields each result as soon as it ends.

While it gets None for a chunk, it waits for results of chunks under way, and then asks again.
"""

_CHUNK_RIG_S: Final = 1000.0
"""Simulated time of all cases of a chunk, s, if that is at least a group of lanes. It takes a
process some tenths of a second, which are lost by a kill."""
_MOST_CHUNKS: Final = 2000
_END: Final = object()
_SHELF: Final = 1024
"""Number of cases that are drawn at once, and sorted so that similar cases run side by side."""


@dataclass
class Timing:
    """The times that the cases of one call of `run_sweep` took.

    Attributes:
        cases: number of cases that were run.
        rig_s: simulated time of these cases, s.
        process_s: processor time of all processes, without start-up, s.
        busy_s: wall-clock time that the processes were running cases, added up, s.
        start_s: time from the start until the first process began to run cases, s.
        elapsed_s: time from the start to the last result, s.
        ready_s: time from the start until a process began to run cases, s, by the process's name.
    """

    cases: int = 0
    rig_s: float = 0.0
    process_s: float = 0.0
    busy_s: float = 0.0
    start_s: float = 0.0
    elapsed_s: float = 0.0
    ready_s: dict[str, float] = field(default_factory=dict)

    def add(self, judged: Judged, cases: int, rig_s: float, received_s: float) -> None:
        """Add the times of a chunk; only `elapsed_s` is left as it is.

        Args:
            judged: the chunk's result.
            cases: number of its cases.
            rig_s: simulated time of its cases, s.
            received_s: when the result came, counted from the start, s.
        """
        self.ready_s.setdefault(judged.worker, received_s - judged.wall_s)
        self.start_s = min(self.ready_s.values())
        self.cases += cases
        self.rig_s += rig_s
        self.process_s += judged.process_s
        self.busy_s += judged.wall_s

    def plain(self) -> dict[str, Any]:
        """Return the times as JSON-able values, with rates in simulated seconds per second.

        The rates are those per second of processor time, per second in which a process ran cases,
        and per second of a process since it began with them; None if no case was run.
        """
        after_start = sum(self.elapsed_s - ready_s for ready_s in self.ready_s.values())
        return {
            "cases": self.cases,
            "rig_s": self.rig_s,
            "processes": len(self.ready_s),
            "start_s": self.start_s,
            "elapsed_s": self.elapsed_s,
            "rig_seconds_per_second": {
                "of_processor": _rate(self.rig_s, self.process_s),
                "of_process": _rate(self.rig_s, self.busy_s),
                "of_process_after_start": _rate(self.rig_s, after_start),
            },
        }


def _rate(rig_s: float, seconds: float) -> float | None:
    return rig_s / seconds if rig_s > 0.0 and seconds > 0.0 else None


def chunk_size(sweep: Sweep) -> int:
    """Return how many cases a chunk of a sweep has, a multiple of the number of lanes."""
    groups = max(1, round(_CHUNK_RIG_S / (sweep.duration_s * LANES)))
    groups = max(groups, ceil(sweep.cases / (_MOST_CHUNKS * LANES)))
    size = groups * LANES
    return size if sweep.adaptive is None else min(size, sweep.adaptive.batch)


def chunks_of(sweep: Sweep) -> dict[int, int]:
    """Return the number of cases of each chunk of a sweep, by the chunk's number.

    An adaptive sweep may be over before its last chunks.
    """
    size = chunk_size(sweep)
    counts = (
        min(size, count - begin) for _, count in _shelves(sweep) for begin in range(0, count, size)
    )
    return dict(enumerate(counts))


def _shelves(sweep: Sweep) -> Iterator[tuple[int, int]]:
    """Yield the number of the first case, and how many cases, of each lot that is drawn at once.

    A lot has whole chunks, except that the last one ends with the sweep; of an adaptive sweep it is
    a batch, whose last chunk ends with it.
    """
    size = chunk_size(sweep)
    shelf = size * ceil(_SHELF / size) if sweep.adaptive is None else sweep.adaptive.batch
    for first in range(0, sweep.cases, shelf):
        yield first, min(shelf, sweep.cases - first)


def drawn_chunks(sweep: Sweep, wanted: Collection[int]) -> Iterator[Cases]:
    """Yield the chunks whose numbers are in `wanted`, in ascending order of their numbers.

    The cases that are drawn at once are sorted first, so that a chunk has similar cases.
    """
    for first, count, chunks in _lots(sweep, wanted):
        yield from _divided(draw(sweep, first, count), chunks, chunk_size(sweep), wanted)


def adaptive_chunks(sweep: Sweep, wanted: Collection[int], drawing: AdaptiveDrawing) -> Chunks:
    """Yield chunks of an adaptive sweep as `drawn_chunks` does, up to where all places are done.

    None is yielded again and again while the next chunk follows from results that are not known.

    Args:
        sweep: the sweep.
        wanted: numbers of the chunks.
        drawing: decides the batches from the results that it is given.
    """
    for first, count, chunks in _lots(sweep, wanted):
        while (spans := drawing.spans(first)) is None:
            yield None
        if not spans:
            return
        yield from _divided(draw(sweep, first, count, spans), chunks, chunk_size(sweep), wanted)


def _lots(sweep: Sweep, wanted: Collection[int]) -> Iterator[tuple[int, int, range]]:
    """Yield first case, number of cases, and chunks of each lot that has a wanted chunk."""
    size, chunk = chunk_size(sweep), 0
    for first, count in _shelves(sweep):
        chunks = range(chunk, chunk + ceil(count / size))
        chunk = chunks.stop
        if any(each in wanted for each in chunks):
            yield first, count, chunks


def _divided(lot: Cases, chunks: range, size: int, wanted: Collection[int]) -> Iterator[Cases]:
    """Yield the wanted chunks of a lot of cases, each of which has similar cases."""
    order = lot.alike()
    for at, chunk in enumerate(chunks):
        if chunk in wanted:
            yield lot.of(order[at * size : (at + 1) * size], chunk)


def adaptive_drawing(sweep: Sweep, folder: SweepFolder) -> AdaptiveDrawing | None:
    """Return what decides the batches of an adaptive sweep, with the results in its folder.

    It is None for any other sweep.
    """
    if sweep.adaptive is None:
        return None
    drawing = AdaptiveDrawing(sweep)
    for rows in folder.rows():
        drawing.add(rows)
    return drawing


def is_complete(sweep: Sweep, folder: SweepFolder) -> bool:
    """Return whether the folder has all cases that the sweep needs."""
    chunks = chunks_of(sweep)
    left = chunks.keys() - folder.done(chunks).keys()
    drawing = adaptive_drawing(sweep, folder)
    if drawing is None or not left:
        return not left
    return next(adaptive_chunks(sweep, left, drawing), _END) is _END


def run_sweep(
    sweep: Sweep,
    folder: SweepFolder,
    runner: Runner,
    stopped: Stopped,
    advanced: Callable[[int], None],
) -> Timing:
    """Run the unfinished cases of a sweep, write them to its folder, and return the times it took.

    Args:
        sweep: the sweep to run.
        folder: the sweep's folder, with the chunks that are finished.
        runner: runs the chunks, such as `run_here`.
        stopped: once it returns True, the runner ends before all chunks are run.
        advanced: is called with the number of newly finished cases; first with those that were
            finished before.

    Raises:
        SweepError: a case could not be run, or a worker has another version of this program.
        OSError: the folder cannot be written.
    """
    started, timing = time.perf_counter(), Timing()
    all_chunks = chunks_of(sweep)
    done = folder.done(all_chunks)
    drawing = adaptive_drawing(sweep, folder)
    left = all_chunks.keys() - done.keys()
    advanced(sum(done.values()))
    drawn: dict[int, Cases] = {}

    def chunks() -> Chunks:
        if drawing is None:
            found: Chunks = drawn_chunks(sweep, left)
        else:
            found = adaptive_chunks(sweep, left, drawing)
        for cases in found:
            if cases is not None:
                drawn[cases.chunk] = cases
            yield cases

    setting = setting_of(sweep)
    asked = columns_told(setting.asked)
    for judged in runner(chunks(), setting, stopped):
        received_s = time.perf_counter() - started
        if judged.source != sources():
            raise SweepError(
                f"the worker {judged.worker} runs another version of this program; install the "
                "same on all machines"
            )
        cases = drawn.pop(judged.chunk)
        rows = rows_of(cases, dict(judged.figures), asked)
        folder.keep(judged.chunk, rows)
        if drawing is not None:
            drawing.add(rows)
        timing.add(judged, cases.numbers.size, cases.numbers.size * sweep.duration_s, received_s)
        timing.elapsed_s = time.perf_counter() - started
        advanced(cases.numbers.size)
    return timing
