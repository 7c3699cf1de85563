"""Measures how much readers of the live stream delay the loop.

`python -m tools.bench.readers` runs the whole chain (`tools.bench.loop_chain`) with a publisher.
Readers come for a few seconds and leave again: one, one that is stalled, a slow one, a hostile one,
and fifty. Each stretch with readers is compared with the stretch without them just before or after
it, so that a busy machine disturbs both. `--page FILE` also writes the table into a page, between
two marks.
"""

import argparse
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.configuration.rigs.rig import Rig, load_rig
from rig.plant.integrator import TICK
from rig.stream.messages import KINDS, command_key, key
from rig.stream.sessions import subscriber_session
from rig.stream.settings import Endpoint, StreamSettings
from rig.supervisor.processes.streaming import Stream

from .loop_chain import CHANNELS, Chain, TrippedError
from .shares import shares

Array = NDArray[np.float64]

BEGIN_MARK: Final = "<!-- table by tools.bench.readers: begin -->"
END_MARK: Final = "<!-- table by tools.bench.readers: end -->"
RIG: Final = "bench"
PROCESSES: Final = 5
"""Number of processes that a group of readers shares at most."""
SETTLE_S: Final = 1.0
"""s that are not measured after readers came or left, because their programs start or end then."""
SLOW_S: Final = 0.2
"""s that a slow reader takes for each message."""
MOST_TRIES: Final = 4
"""A run whose loop trips is repeated until this many runs have tripped."""
TIMES: Final = ("wakeup_s", "sent_s", "compute_s")


@dataclass(frozen=True)
class Readers:
    """A group of readers of the stream, all of one kind.

    Attributes:
        name: of the group, for the table.
        what: their behaviour, a key of `BEHAVIOURS`.
        count: number of readers.
        stopped: whether their processes are stopped (SIGSTOP) once they follow the stream.
    """

    name: str
    what: str
    count: int = 1
    stopped: bool = False


READERS: Final = (
    Readers("one", "read"),
    Readers("one that is stalled", "read", stopped=True),
    Readers("one that is slow", "dawdle"),
    Readers("one that is hostile", "assail"),
    Readers("fifty", "read", 50),
)


@dataclass
class Pairs:
    """The percentiles of pairs of stretches, one with readers and one without.

    Attributes:
        with_: for each pair, (times, 2): p50 and p99 of each of `TIMES` with readers, s.
        without: the same without readers.
        missed: for each pair, the shares of ticks missed with and without readers.
        lacking: number of rows that are missing in the recordings.
        trips: why the loop tripped, for each run that was repeated because of it.
    """

    with_: list[Array] = field(default_factory=list)
    without: list[Array] = field(default_factory=list)
    missed: list[tuple[float, float]] = field(default_factory=list)
    lacking: int = 0
    trips: list[str] = field(default_factory=list)

    def row(self, name: str) -> tuple[str, ...]:
        """Return the cells of the table's row on these pairs, with medians over the pairs.

        They are the name; p50 and p99 of the wake-up without -> with readers, us; the ratios, with
        to without, of both percentiles of all `TIMES`; the share of ticks missed; rows missing.
        """
        ratios = np.median(np.array(self.with_) / np.array(self.without), axis=0)
        before, after = (np.median(each, axis=0) for each in (self.without, self.with_))
        missed = np.median(np.array(self.missed), axis=0)
        return (
            name,
            *(f"{1e6 * before[0, k]:.0f} -> {1e6 * after[0, k]:.0f}" for k in range(2)),
            *(f"{ratio:.2f}" for ratio in ratios.ravel()),
            f"{100.0 * missed[1]:.2f} -> {100.0 * missed[0]:.2f} %",
            str(self.lacking),
        )


# -- readers, which run in processes of their own --------------------------------------------------


def read(endpoint: Endpoint) -> None:
    """Start to follow all messages, and do nothing with them; return at once."""
    session = subscriber_session(StreamSettings(), (endpoint,))
    _KEPT.append(session)
    _KEPT.append(session.declare_subscriber(key("*", "*"), lambda sample: None))


def dawdle(endpoint: Endpoint) -> None:
    """Start to follow all messages, and take `SLOW_S` for each; return at once."""
    session = subscriber_session(StreamSettings(), (endpoint,))
    _KEPT.append(session)
    dawdling = session.declare_subscriber(key("*", "*"), lambda sample: time.sleep(SLOW_S))
    _KEPT.append(dawdling)


def assail(endpoint: Endpoint) -> None:
    """Start to follow, and to send nonsense, queries and forged commands as fast as possible.

    The messages are of several sizes. A thread sends them; the function returns at once.
    """
    read(endpoint)
    session = subscriber_session(StreamSettings(), (endpoint,))
    _KEPT.append(session)

    def flood() -> None:
        while True:
            for kind in KINDS:
                session.get(key(RIG, kind) + "?last=1e9", lambda reply: None)
                session.put(key(RIG, kind), secrets.token_bytes(1000))
            for payload in (b"", secrets.token_bytes(200), bytes(50_000), bytes(200_000)):
                session.get(command_key(RIG, "abort"), lambda reply: None, payload=payload)
                session.put(command_key(RIG, "abort"), payload)

    threading.Thread(target=flood, daemon=True).start()


BEHAVIOURS: Final[dict[str, Callable[[Endpoint], None]]] = {
    "read": read,
    "dawdle": dawdle,
    "assail": assail,
}
_KEPT: Final[list[object]] = []


def be(what: str, endpoint: str, count: int) -> None:
    """Run `count` readers with the behaviour `what` in this process; this never returns.

    The line "follows" is printed 0.5 s after the last one began to follow.
    """
    for _ in range(count):
        BEHAVIOURS[what](Endpoint.parse(endpoint))
    time.sleep(0.5)
    print("follows", flush=True)
    threading.Event().wait()


@contextmanager
def present(readers: Readers, endpoint: Endpoint) -> Iterator[None]:
    """Start processes with readers, enter the context once all follow, and kill them at its end.

    At most `PROCESSES` processes share the readers as evenly as can be.
    """
    command = [sys.executable, "-m", "tools.bench.readers", "--be", readers.what, str(endpoint)]
    processes = [
        subprocess.Popen([*command, str(share)], stdout=subprocess.PIPE, text=True)
        for share in shares(readers.count, PROCESSES)
    ]
    try:
        for process in processes:
            assert process.stdout is not None
            process.stdout.readline()
            if readers.stopped:
                process.send_signal(signal.SIGSTOP)
        yield
    finally:
        for process in processes:
            process.kill()
            process.communicate()


# -- measuring -------------------------------------------------------------------------------------


def compare(rig: Rig, readers: Readers, pairs: int, seconds: float) -> Pairs:
    """Measure pairs of stretches, with readers and without, in one run of the chain.

    If the loop trips, as it should when the machine stops it for long, the run is repeated.

    Args:
        rig: the emulated rig.
        readers: the readers that come and leave.
        pairs: number of pairs.
        seconds: length of each stretch, s.

    Raises:
        TrippedError: the loop tripped in `MOST_TRIES` runs.
    """
    trips: list[str] = []
    while True:
        try:
            found = _run(rig, readers, pairs, seconds)
        except TrippedError as error:
            trips.append(str(error))
            if len(trips) >= MOST_TRIES:
                raise
            continue
        found.trips = trips
        return found


def _run(rig: Rig, readers: Readers, pairs: int, seconds: float) -> Pairs:
    found = Pairs()
    count = round(seconds / TICK)
    lasts = pairs * (2.0 * seconds + 60.0)
    with Chain(rig, lasts) as chain, _published(chain) as endpoint:
        for number in range(pairs):
            stretches: dict[bool, Array] = {}
            # The order alternates, so that a slow change of the machine affects both alike.
            for is_with in (False, True) if number % 2 == 0 else (True, False):
                if is_with:
                    with present(readers, endpoint):
                        stretches[True] = _stretch(chain, count)
                else:
                    stretches[False] = _stretch(chain, count)
            found.with_.append(_percentiles(stretches[True]))
            found.without.append(_percentiles(stretches[False]))
            found.missed.append((_missed(stretches[True]), _missed(stretches[False])))
        found.lacking = chain.finish()
    return found


def _stretch(chain: Chain, count: int) -> Array:
    chain.rows(round(SETTLE_S / TICK))
    return chain.rows(count)


@contextmanager
def _published(chain: Chain) -> Iterator[Endpoint]:
    """Publish the rows of a chain on the live stream, and yield the endpoint."""
    with TemporaryDirectory() as folder, socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        endpoint = Endpoint("tcp", "127.0.0.1", free.getsockname()[1])
        free.close()
        settings = StreamSettings(listen=(endpoint,))
        log = Path(folder) / "log"
        stream = Stream(settings, RIG, log, _ignore, lambda command: "nothing is obeyed here")
        stream.attach(chain.board, CHANNELS)
        try:
            yield endpoint
        finally:
            stream.close()


def _ignore(text: str) -> None:
    """Ignore a message of the publisher, which reports every forged command."""


def _percentiles(rows: Array) -> Array:
    columns = rows[:, [CHANNELS.index(name) for name in TIMES]]
    found: Array = np.nanpercentile(columns, (50.0, 99.0), axis=0).T
    return found


def _missed(rows: Array) -> float:
    return float(np.mean(np.isnan(rows[:, CHANNELS.index("wakeup_s")])))


def table(rows: list[tuple[str, ...]], pairs: int, seconds: float, trips: list[str]) -> str:
    """Return a sentence on the measurement and its table, in Markdown."""
    heads = (
        "readers", "wake-up p50, us", "wake-up p99, us", "wake-up p50", "p99",
        "tick to command p50", "p99", "computing p50", "p99", "ticks missed", "rows not recorded",
    )  # fmt: skip
    lines = [heads, tuple("---" if i == 0 else "---:" for i in range(len(heads))), *rows]
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    tripped = (
        f" {len(trips)} runs were repeated, as the loop tripped: {', '.join(sorted(set(trips)))}."
        if trips
        else ""
    )
    return (
        f"Medians of {pairs} pairs of {seconds:g} s with readers beside {seconds:g} s without, and "
        f"of the ratios with to without; {os.cpu_count()} processors, load average at the end "
        f"{os.getloadavg()[0]:.1f}.{tripped}\n\n{text}\n"
    )


def main() -> None:
    """Run the benchmark and print its table; with `--page`, write it into that page too."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=5, help="how often each is measured")
    parser.add_argument("--seconds", type=float, default=5.0, help="how long, each time")
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--be", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.be is not None:
        be(given.be[0], given.be[1], int(given.be[2]))
    rig = load_rig("emulated")
    rows, trips = [], []
    for readers in READERS:
        found = compare(rig, readers, given.pairs, given.seconds)
        rows.append(found.row(readers.name))
        trips += found.trips
        print(" | ".join(rows[-1]), flush=True)
    text = table(rows, given.pairs, given.seconds, trips)
    print(f"\n{text}")
    if given.page is not None:
        page = given.page.read_text()
        before, _, rest = page.partition(BEGIN_MARK)
        _, _, after = rest.partition(END_MARK)
        given.page.write_text(f"{before}{BEGIN_MARK}\n{text}{END_MARK}{after}")


if __name__ == "__main__":
    main()
