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
from .run_cases import Judged, run_chunk
from .setting import Setting, SweepError

Stopped = Callable[[], bool]

_MOST_DEATHS: Final = 3
"""How often a process may die while it runs a chunk, until the chunk is taken to be the cause."""
_QUEUED: Final = 2
"""Chunks on their way for each process: the next one is there when it has finished one."""
_POLL_S: Final = 0.2


def run_here(chunks: Iterator[Cases], setting: Setting, stopped: Stopped) -> Iterator[Judged]:
    """Yield what comes of chunks, run one after another in this process, until `stopped`.

    Raises:
        SweepError: a case could not be run.
    """
    for cases in chunks:
        if stopped():
            return
        yield run_chunk(setting, cases)


def run_pool(
    chunks: Iterator[Cases], setting: Setting, jobs: int, stopped: Stopped
) -> Iterator[Judged]:
    """Yield what comes of chunks, run by `jobs` processes, in the order in which they end.

    Once `stopped`, chunks that are under way are still finished. Should a process die, its chunk is
    run again by another.

    Raises:
        SweepError: a case could not be run, or processes die of it.
    """
    deaths: Counter[int] = Counter()
    again: deque[Cases] = deque()
    while True:
        with _pool(jobs) as pool:
            running: dict[Future[Judged], Cases] = {}
            try:
                yield from _run(pool, chunks, again, running, setting, jobs, stopped)
                return
            except BrokenProcessPool:
                # Which of them it was, nobody knows.
                again.extendleft(sorted(running.values(), key=lambda cases: -cases.chunk))
                deaths.update(cases.chunk for cases in running.values())
        worst, count = deaths.most_common(1)[0] if deaths else (0, _MOST_DEATHS + 1)
        if count > _MOST_DEATHS:
            numbers = next(cases.numbers for cases in again if cases.chunk == worst)
            raise SweepError(
                f"cases {', '.join(map(str, sorted(numbers)))}: {count} processes died while they "
                "ran; is there memory enough? Fewer --jobs need less"
            )


def _run(
    pool: ProcessPoolExecutor,
    chunks: Iterator[Cases],
    again: deque[Cases],
    running: dict[Future[Judged], Cases],
    setting: Setting,
    jobs: int,
    stopped: Stopped,
) -> Iterator[Judged]:
    """Keep the pool busy; what is still in `running` when it breaks has not been yielded."""
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
        broken: BrokenProcessPool | None = None
        for future in ended:
            try:
                judged = future.result()
            except BrokenProcessPool as error:
                broken = error
                continue
            del running[future]
            yield judged
        if broken is not None:
            raise broken


def _pool(jobs: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(jobs, get_context("spawn"), initializer=_start_worker)


def _start_worker() -> None:
    """Leave signals to the program that started this process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A process for each core: small matrices gain nothing from threads of their own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is None:
        return
    try:
        connection.wait([parent.sentinel])
    finally:
        # A process that cannot know whether its parent lives is not left behind.
        os._exit(1)
