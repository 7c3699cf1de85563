"""Measure what readers of the live stream cost the loop: stalled, slow, hostile ones, and fifty.

`python -m tools.bench.readers` lets the whole chain run (`tools.bench.loop_chain`) with a
publisher, and has readers come and go, a few seconds each: every stretch with them is compared with
the one before or after it without, so that a busy moment of the machine meets both. `--page FILE`
also writes the table into a page, between its marks.
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

Array = NDArray[np.float64]

BEGIN_MARK: Final = "<!-- table by tools.bench.readers: begin -->"
END_MARK: Final = "<!-- table by tools.bench.readers: end -->"
RIG: Final = "bench"
PROCESSES: Final = 5
"""That fifty readers are shared out to: so many programs may run on two processors."""
SETTLE_S: Final = 1.0
"""After readers came or went: the programs that they are begin and end."""
SLOW_S: Final = 0.2
"""What a slow reader does for each message."""
MOST_TRIES: Final = 4
TIMES: Final = ("wakeup_s", "sent_s", "compute_s")


@dataclass(frozen=True)
class Readers:
    """Readers of the stream.

    Attributes:
        name: for the table.
        what: they do, one of `BEHAVIOURS`.
        count: how many.
        stopped: whether they are stopped (SIGSTOP) once they follow.
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
    """Percentiles of stretches with readers, and of those beside them without.

    Attributes:
        with_: (pairs, times, 2): p50 and p99 of each of `TIMES`, s.
        without: the same.
        missed: (pairs, 2): share of ticks missed, with and without.
        lacking: rows that recordings lacked.
        trips: runs that were given up because the loop tripped, with the time within a stretch.
    """

    with_: list[Array] = field(default_factory=list)
    without: list[Array] = field(default_factory=list)
    missed: list[tuple[float, float]] = field(default_factory=list)
    lacking: int = 0
    trips: list[str] = field(default_factory=list)

    def row(self, name: str) -> tuple[str, ...]:
        """Return the table's row: medians over the pairs."""
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


# -- readers, in processes of their own ------------------------------------------------------------


def read(endpoint: Endpoint) -> None:
    """Follow everything, and do nothing with it."""
    session = subscriber_session(StreamSettings(), (endpoint,))
    _KEPT.append(session)
    _KEPT.append(session.declare_subscriber(key("*", "*"), lambda sample: None))


def dawdle(endpoint: Endpoint) -> None:
    """Follow everything, and take long for each message."""
    session = subscriber_session(StreamSettings(), (endpoint,))
    _KEPT.append(session)
    dawdling = session.declare_subscriber(key("*", "*"), lambda sample: time.sleep(SLOW_S))
    _KEPT.append(dawdling)


def assail(endpoint: Endpoint) -> None:
    """Send nonsense, questions and forgeries, large and small, as fast as it goes."""
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
    """Be so many readers, for ever."""
    for _ in range(count):
        BEHAVIOURS[what](Endpoint.parse(endpoint))
    time.sleep(0.5)
    print("follows", flush=True)
    threading.Event().wait()


@contextmanager
def present(readers: Readers, endpoint: Endpoint) -> Iterator[None]:
    """Have readers there."""
    shares = [readers.count // PROCESSES] * PROCESSES if readers.count > PROCESSES else [1]
    command = [sys.executable, "-m", "tools.bench.readers", "--be", readers.what, str(endpoint)]
    processes = [
        subprocess.Popen([*command, str(share)], stdout=subprocess.PIPE, text=True)
        for share in shares
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
    """Return stretches with readers, and beside them without, of one run of the chain.

    A run in which the loop trips, as it should where the machine stops it for long, is repeated.

    Raises:
        TrippedError: it trips again and again.
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
            # Turn about, so that whatever drifts meets both.
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
    """Publish a chain's rows; yield where."""
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
    """Take no note of what a publisher tells: forgeries make it tell much."""


def _percentiles(rows: Array) -> Array:
    columns = rows[:, [CHANNELS.index(name) for name in TIMES]]
    found: Array = np.nanpercentile(columns, (50.0, 99.0), axis=0).T
    return found


def _missed(rows: Array) -> float:
    return float(np.mean(np.isnan(rows[:, CHANNELS.index("wakeup_s")])))


def table(rows: list[tuple[str, ...]], pairs: int, seconds: float, trips: list[str]) -> str:
    """Return the measurement as Markdown."""
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
    """Print the table; put it into a page if asked."""
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
