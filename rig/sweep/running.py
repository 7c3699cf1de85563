"""Runs a sweep: what is not done yet, chunk by chunk, each kept as soon as it is there."""

import time
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from math import ceil
from typing import Any, Final

from rig.configuration import Sweep
from rig.lanes import LANES

from .drawing import Cases, draw
from .folder import SweepFolder
from .local import Stopped
from .run_cases import Judged, sources
from .setting import Setting, SweepError, setting_of
from .table import rows_of

Runner = Callable[[Iterator[Cases], Setting, Stopped], Iterator[Judged]]
"""Runs chunks somewhere, and yields what comes of each as it ends."""

_CHUNK_RIG_S: Final = 1000.0
"""Rig-seconds of a chunk, at least a group of lanes: what a kill costs each process, some tenths
of a second."""
_MOST_CHUNKS: Final = 2000
_SHELF: Final = 1024
"""Cases that are drawn at once, and sorted so that those side by side in lanes are alike."""


@dataclass
class Timing:
    """What it took to run the cases that were not done before.

    Attributes:
        cases: how many.
        rig_s: rig-seconds of them.
        process_s: processor seconds of all processes that ran them, without start-up.
        busy_s: seconds of these processes, added up, without start-up.
        start_s: seconds until the first of them ran a case.
        elapsed_s: seconds from the start to the last result.
        ready_s: by process, seconds from the start until it ran its first case.
    """

    cases: int = 0
    rig_s: float = 0.0
    process_s: float = 0.0
    busy_s: float = 0.0
    start_s: float = 0.0
    elapsed_s: float = 0.0
    ready_s: dict[str, float] = field(default_factory=dict)

    def add(self, judged: Judged, cases: int, rig_s: float, received_s: float) -> None:
        """Count a chunk of cases and rig-seconds, the result of which came at a time, s."""
        self.ready_s.setdefault(judged.worker, received_s - judged.wall_s)
        self.start_s = min(self.ready_s.values())
        self.cases += cases
        self.rig_s += rig_s
        self.process_s += judged.process_s
        self.busy_s += judged.wall_s

    @property
    def workers(self) -> set[str]:
        """Return the names of the processes that ran the cases."""
        return set(self.ready_s)

    def plain(self) -> dict[str, Any]:
        """Return it as JSON holds it, with rates."""
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
    """Return how many cases a chunk has: whole groups of lanes."""
    groups = max(1, round(_CHUNK_RIG_S / (sweep.duration_s * LANES)))
    groups = max(groups, ceil(sweep.cases / (_MOST_CHUNKS * LANES)))
    return groups * LANES


def chunks_of(sweep: Sweep) -> dict[int, int]:
    """Return the number of cases of each chunk, by its own."""
    size = chunk_size(sweep)
    found: dict[int, int] = {}
    for _, count in _shelves(sweep):
        for begin in range(0, count, size):
            found[len(found)] = min(size, count - begin)
    return found


def _shelves(sweep: Sweep) -> Iterator[tuple[int, int]]:
    """Yield first case and number of those that are drawn, and sorted into chunks, at once."""
    size = chunk_size(sweep)
    shelf = size * ceil(_SHELF / size)
    for first in range(0, sweep.cases, shelf):
        yield first, min(shelf, sweep.cases - first)


def drawn_chunks(sweep: Sweep, wanted: Collection[int]) -> Iterator[Cases]:
    """Yield the chunks that are wanted, of cases that cost about the same side by side."""
    size, chunk = chunk_size(sweep), 0
    for first, count in _shelves(sweep):
        chunks = range(chunk, chunk + ceil(count / size))
        chunk = chunks.stop
        if not any(each in wanted for each in chunks):
            continue
        cases = draw(sweep, first, count)
        order = cases.alike()
        for at, each in enumerate(chunks):
            if each in wanted:
                yield cases.of(order[at * size : (at + 1) * size], each)


def run_sweep(
    sweep: Sweep,
    folder: SweepFolder,
    runner: Runner,
    stopped: Stopped,
    advanced: Callable[[int], None],
) -> Timing:
    """Run the cases of a sweep that are not done yet, and keep them in its folder.

    Args:
        sweep: what to run.
        folder: of the sweep, with what is done.
        runner: where.
        stopped: whether to end before all is done.
        advanced: is called with how many cases more are done, those from before first.

    Raises:
        SweepError: a case could not be run, or a worker has another version of this program.
        OSError: the folder cannot be written.
    """
    started, timing = time.perf_counter(), Timing()
    all_chunks = chunks_of(sweep)
    done = folder.done(all_chunks)
    left = all_chunks.keys() - done.keys()
    advanced(sum(done.values()))
    drawn: dict[int, Cases] = {}

    def chunks() -> Iterator[Cases]:
        for cases in drawn_chunks(sweep, left):
            drawn[cases.chunk] = cases
            yield cases

    for judged in runner(chunks(), setting_of(sweep), stopped):
        received_s = time.perf_counter() - started
        _require_same_sources(judged)
        cases = drawn.pop(judged.chunk)
        folder.keep(judged.chunk, rows_of(cases, dict(judged.figures)))
        timing.add(judged, cases.count, cases.count * sweep.duration_s, received_s)
        timing.elapsed_s = time.perf_counter() - started
        advanced(cases.count)
    return timing


def _require_same_sources(judged: Judged) -> None:
    if judged.source != sources():
        raise SweepError(
            f"the worker {judged.worker} runs another version of this program; install the same "
            "on all machines"
        )
