"""Runs chunks of cases on a Dask cluster, which needs the extra `dask` of this package."""

import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager
from functools import partial
from typing import Any, Final

import numpy as np

from rig.surviving import start

from .drawing import Cases
from .group import Setting, SweepError
from .local import Chunks, Stopped
from .run_cases import Judged, run_chunk, sources

_QUEUED: Final = 3
"""Number of submitted chunks for each thread of the cluster."""
_POLL_S: Final = 0.2
_SOON_S: Final = 0.01
"""Time in s between two looks for what takes little more than a message."""
_CONNECT_S: Final = 10.0
_HANDSHAKE_S: Final = 20.0
"""Longest time in s for a scheduler to answer. It is above `_CONNECT_S`, which Dask counts itself,
not for a program that takes the connection and then says nothing."""
_PARTING_S: Final = 5.0
"""Longest time in s for which a cluster is waited for as its sweep ends."""
_SILENT_S: Final = 10.0
"""Time in s without an answer after which the operator is told that the scheduler is silent."""
_LOOK_S: Final = 2.0
"""Time between two counts of the cluster's workers, s."""
_MESSAGES_KEPT: Final = 20
"""Number of sent messages that Dask's client keeps to diagnose itself. A message has the cases of a
chunk, and by Dask's default of 1000 messages nearly all cases of a sweep would stay in memory."""


class ClusterError(ValueError):
    """Raised for a cluster that cannot be used.

    Attributes:
        problems: the reasons, one line each.
    """

    def __init__(self, problem: str) -> None:
        self.problems = [problem]
        super().__init__(problem)


@contextmanager
def connected(address: str, stopped: Stopped) -> Iterator[Any]:
    """Connect to the scheduler at an address while the context is entered; yield a Dask client.

    Dask waits without limit for a scheduler that takes a connection and says nothing, so it is
    asked in threads that end with this process.

    Args:
        address: address of the scheduler, such as tcp://10.0.0.5:8786.
        stopped: once it returns True, the scheduler is not waited for any longer.

    Raises:
        ClusterError: the extra `dask` is not installed, no scheduler answers at the address within
            20 s, or `stopped` returned True before that.
    """
    try:
        from dask import config
        from distributed import Client
    except ImportError:
        line = "--cluster: distributed is not installed; pip install hydraulic-rig[dask]"
        raise ClusterError(line) from None

    def client() -> Any:
        with config.set({"distributed.admin.low-level-log-length": _MESSAGES_KEPT}):
            return Client(address, timeout=_CONNECT_S, set_as_default=False)

    asked = _asked(client)
    until = time.monotonic() + _HANDSHAKE_S
    while not (asked.done() or stopped()) and time.monotonic() < until:
        time.sleep(_POLL_S)
    if not asked.done():
        why = "stopped before it did" if stopped() else f"nothing came within {_HANDSHAKE_S:g} s"
        raise _unanswered(address, why)
    try:
        found = asked.result()
    # Dask raises TypeError for a protocol that needs more than an address, as tls needs keys.
    except (OSError, ValueError, TypeError, TimeoutError) as error:
        raise _unanswered(address, str(error) or type(error).__name__) from None
    try:
        yield found
    finally:
        _waited_for(_asked(found.close))


def _unanswered(address: str, why: str) -> ClusterError:
    reason = " ".join(why.split())
    line = f"--cluster {address}: no scheduler answers ({reason}); start `dask scheduler` there"
    return ClusterError(line)


def _asked(call: Callable[[], Any]) -> Future[Any]:
    """Call a function in a thread that ends with this process; return its future result."""
    asked: Future[Any] = Future()

    def answer() -> None:
        try:
            asked.set_result(call())
        except Exception as error:
            asked.set_exception(error)

    start(threading.Thread(target=answer, name="cluster", daemon=True))
    return asked


def _waited_for(asked: Future[Any]) -> None:
    """Wait for an answer for `_PARTING_S` at most; whatever it is, and if none comes, go on."""
    until = time.monotonic() + _PARTING_S
    while not asked.done() and time.monotonic() < until:
        time.sleep(_POLL_S)


def run_cluster(
    chunks: Chunks,
    setting: Setting,
    client: Any,
    stopped: Stopped,
    say: Callable[[str], None],
) -> Iterator[Judged]:
    """Run chunks of cases on a cluster, and yield each chunk's result once it is there.

    So the results may come in another order than the chunks. While the cluster has no worker, the
    function waits for one. A chunk that fails is tried up to twice more.

    Args:
        chunks: the chunks to run.
        setting: what all cases of the sweep share.
        client: a client from `connected`.
        stopped: once it returns True, no more chunks are sent, and those under way are cancelled.
        say: shows a line to the operator.

    Raises:
        SweepError: a case could not be run, a worker answered with what cannot be the result, or
            the connection to the cluster was lost.
    """
    ended: queue.Queue[Any] = queue.Queue()
    running: dict[Any, Cases] = {}
    wanted, kinds = _wanted(client, say), dict[str, str]()
    try:
        while True:
            while len(running) < next(wanted) and not stopped():
                cases = next(chunks, None)
                if cases is None:
                    break
                future = client.submit(run_chunk, setting, cases, pure=False, retries=2)
                running[future] = cases
                future.add_done_callback(ended.put)
            if not running or stopped():
                return
            try:
                future = ended.get(timeout=_POLL_S)
            except queue.Empty:
                continue
            cases = running.pop(future)
            result = _asked(partial(_result, future))
            while not (result.done() or stopped()):
                time.sleep(_SOON_S)
            if result.done():
                judged = result.result()
                _require_sound(judged, cases, kinds)
                yield judged
    finally:
        if running:
            _waited_for(_asked(lambda: client.cancel(list(running))))


def _require_sound(judged: object, cases: Cases, kinds: dict[str, str]) -> None:
    """Refuse what a worker answers if it cannot be the result of these cases.

    A worker with damaged memory, or another program in its place, would else fill the table with
    what nobody computed, or with columns that cannot be joined at the sweep's end. That its numbers
    are right cannot be seen.

    Args:
        judged: the answer.
        cases: the cases that the worker was given.
        kinds: numpy's kind of each column of the sweep; filled by the first result.

    Raises:
        SweepError: the answer is no result of these cases.
    """
    if isinstance(judged, Judged) and judged.source != sources():
        return  # `run_sweep` refuses it
    if why := _unsound(judged, cases, kinds):
        worker = getattr(judged, "worker", "of the cluster")
        raise SweepError(f"the worker {worker} answered with {why}; end it, and --resume goes on")


def _unsound(judged: object, cases: Cases, kinds: dict[str, str]) -> str:
    """Return in words what cannot be the result of these cases; empty if it can be."""
    if not isinstance(judged, Judged):
        return "no result"
    if judged.chunk != cases.chunk:
        return "the result of other cases"
    figures, shape = dict(judged.figures), cases.numbers.shape
    if not all(isinstance(each, np.ndarray) and each.shape == shape for each in figures.values()):
        return f"columns that are not of its {shape[0]} cases"
    found = {name: column.dtype.kind for name, column in figures.items()}
    if not found.keys() >= {"verdict", "right"} or found != (kinds or found):
        return "other columns than the sweep has"
    if not np.array_equal(figures["right"], figures["verdict"] == cases.faults):
        return "verdicts that contradict themselves"
    kinds |= found
    return ""


def _wanted(client: Any, say: Callable[[str], None]) -> Iterator[int]:
    """Yield again and again how many chunks should be under way: three for each thread, at least 3.

    The threads of the cluster are counted every 2 s. When there are none any more, a line says so,
    and also when the scheduler has not told their number for 10 s.
    """
    threads, is_silent = 1, False
    asked: Future[Any] | None = None
    since = time.monotonic() - _LOOK_S
    while True:
        waited_s = time.monotonic() - since
        if asked is not None and asked.done():
            # If the scheduler is lost, Dask says so of each chunk.
            if asked.exception() is None:
                threads, before = sum(asked.result().values()), threads
                if threads == 0 and before > 0:
                    say("the cluster has no workers; waiting for one")
            asked = None
        if asked is None and waited_s >= _LOOK_S:
            asked, since, is_silent = _asked(client.nthreads), time.monotonic(), False
        elif asked is not None and waited_s >= _SILENT_S and not is_silent:
            is_silent = True
            say("the cluster's scheduler does not answer; waiting for it")
        yield _QUEUED * max(threads, 1)


def _result(future: Any) -> Judged:
    if future.status == "finished":
        judged: Judged = future.result()
        return judged
    try:
        future.result()
    except SweepError:
        raise
    except Exception as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())
        raise SweepError(f"the cluster could not run a chunk: {why}; --resume goes on") from error
    raise SweepError("the cluster was lost; --resume goes on")
