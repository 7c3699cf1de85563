"""Runs chunks of cases on a Dask cluster, which needs the extra `dask` of this package."""

import queue
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

from .group import Setting, SweepError
from .local import Chunks, Stopped
from .run_cases import Judged, run_chunk

_QUEUED: Final = 3
"""Number of submitted chunks for each thread of the cluster."""
_POLL_S: Final = 0.2
_CONNECT_S: Final = 10.0
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


def connect(address: str) -> Any:
    """Return a Dask client that is connected to the scheduler at an address.

    Raises:
        ClusterError: the extra `dask` is not installed, or no scheduler answers at the address.
    """
    try:
        from dask import config
        from distributed import Client
    except ImportError:
        line = "--cluster: distributed is not installed; pip install hydraulic-rig[dask]"
        raise ClusterError(line) from None
    try:
        with config.set({"distributed.admin.low-level-log-length": _MESSAGES_KEPT}):
            return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as error:
        why = " ".join(str(error).split()) or type(error).__name__
        line = f"--cluster {address}: no scheduler answers ({why}); start `dask scheduler` there"
        raise ClusterError(line) from None


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
        client: a client from `connect`.
        stopped: once it returns True, no more chunks are sent, and those under way are cancelled.
        say: shows a line to the operator.

    Raises:
        SweepError: a case could not be run, or the connection to the cluster was lost.
    """
    ended: queue.Queue[Any] = queue.Queue()
    running: set[Any] = set()
    wanted = _wanted(client, say)
    try:
        while True:
            while len(running) < next(wanted) and not stopped():
                cases = next(chunks, None)
                if cases is None:
                    break
                future = client.submit(run_chunk, setting, cases, pure=False, retries=2)
                running.add(future)
                future.add_done_callback(ended.put)
            if not running or stopped():
                return
            try:
                future = ended.get(timeout=_POLL_S)
            except queue.Empty:
                continue
            running.discard(future)
            yield _result(future)
    finally:
        if running:
            client.cancel(list(running))


def _wanted(client: Any, say: Callable[[str], None]) -> Iterator[int]:
    """Yield again and again how many chunks should be under way: three for each thread, at least 3.

    The threads of the cluster are counted every 2 s. When there are none any more, a line says so.
    """
    next_look, threads = 0.0, 1
    while True:
        now = time.monotonic()
        if now >= next_look:
            next_look, before = now + _LOOK_S, threads
            threads = sum(client.nthreads().values())
            if threads == 0 and before > 0:
                say("the cluster has no workers; waiting for one")
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
