"""Runs chunks of cases on this machine: in this process, or on a pool of processes."""

import os
import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_context, parent_process
from typing import Final

from .drawing import Cases
from .group import Setting, SweepError
from .run_cases import Judged, run_chunk

Stopped = Callable[[], bool]
Chunks = Iterator[Cases | None]
"""Chunks of cases to run; None where the next chunk follows from results that are not there yet."""

_MOST_DEATHS: Final = 3
"""How often processes may die while a chunk is run before the sweep is given up for that chunk."""
_QUEUED: Final = 2
"""Number of submitted chunks for each process, so that a process never waits for its next chunk."""
_POLL_S: Final = 0.2


def run_here(chunks: Chunks, setting: Setting, stopped: Stopped) -> Iterator[Judged]:
    """Run chunks of cases one after another in this process, and yield the result of each.

    Args:
        chunks: the chunks to run.
        setting: what all cases of the sweep share.
        stopped: once it returns True, no further chunk is run.

    Raises:
        SweepError: a case could not be run.
    """
    for cases in chunks:
        if stopped():
            return
        if cases is not None:
            yield run_chunk(setting, cases)


def run_pool(chunks: Chunks, setting: Setting, jobs: int, stopped: Stopped) -> Iterator[Judged]:
    """Run chunks of cases on a pool of processes, and yield each chunk's result once it is there.

    So the results may come in another order than the chunks. If a process dies, the chunks that
    have no result yet are run again by new processes.

    Args:
        chunks: the chunks to run.
        setting: what all cases of the sweep share.
        jobs: number of processes.
        stopped: once it returns True, no further chunk is begun; those that a process has begun are
            still finished, and their results are yielded.

    Raises:
        SweepError: a case could not be run, or a process died more than three times while the same
            chunk was under way.
    """
    deaths: Counter[int] = Counter()
    again: deque[Cases] = deque()

    def results(
        pool: ProcessPoolExecutor, running: dict[Future[Judged], Cases]
    ) -> Iterator[Judged]:
        """Run chunks on one pool, and yield their results.

        If a process of the pool dies, BrokenProcessPool is raised, and `running`, which is updated,
        then holds the submitted chunks without a result.
        """
        while True:
            while len(running) < _QUEUED * jobs and not stopped():
                cases = again.popleft() if again else next(chunks, None)
                if cases is None:
                    break
                try:
                    running[pool.submit(run_chunk, setting, cases)] = cases
                except BrokenProcessPool:
                    again.appendleft(cases)
                    raise
            if not running:
                return
            if stopped():
                for future in [each for each in running if each.cancel()]:
                    del running[future]
            ended, _ = wait(running, timeout=_POLL_S, return_when=FIRST_COMPLETED)
            # A result that came before the pool broke is not lost.
            for future in sorted(ended, key=lambda each: each.exception() is not None):
                judged = future.result()
                del running[future]
                yield judged

    while True:
        running: dict[Future[Judged], Cases] = {}
        with ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_start_worker) as pool:
            try:
                yield from results(pool, running)
                return
            except BrokenProcessPool:
                # It is not known which of the running chunks killed the process.
                again.extendleft(sorted(running.values(), key=lambda cases: -cases.chunk))
                deaths.update(cases.chunk for cases in running.values())
        if not deaths:
            raise SweepError("the processes died before they ran a case; is there memory enough?")
        worst, count = deaths.most_common(1)[0]
        if count > _MOST_DEATHS:
            numbers = next(cases.numbers for cases in again if cases.chunk == worst)
            raise SweepError(
                f"cases {', '.join(map(str, sorted(numbers)))}: {count} processes died while they "
                "ran; is there memory enough? Fewer --jobs need less"
            )


def _start_worker() -> None:
    """Prepare this process of the pool to ignore Ctrl-C, and to end when its parent ends.

    OpenBLAS is set to use one thread, unless the environment sets a number.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Each core has a process already, so that more threads for small matrices would gain nothing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    assert parent is not None
    try:
        connection.wait([parent.sentinel])
    finally:
        # If the wait fails, the parent's state is unknown, and the process ends, too.
        os._exit(1)
