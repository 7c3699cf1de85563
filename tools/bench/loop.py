"""Times the loop, idle and with the whole chain on an emulated rig, and compares with cyclictest.

`python -m tools.bench.loop` runs four things in each round: cyclictest (of rt-tests), if it is
installed; the loop with nothing to exchange; the loop with Modbus exchanges, filter, interlock and
ring; and the same under the tracking law with a cyclic setpoint. During the last two, the recorder
writes all rows to disk, and a subscriber turns every row into JSON as fast as it can. `--page FILE`
also writes the table into a page, between two marks.
"""

import argparse
import dataclasses
import json
import os
import platform
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings
from estimator.filters.registry import compiled_filter, start_memory
from rig.configuration.rigs.rig import Rig, load_rig
from rig.loop.board import Board, RingReader, Word
from rig.loop.interlocks.judging import interlock
from rig.loop.interlocks.ladder import limit_table
from rig.loop.realtime import RealTime
from rig.loop.wire.cycle import wire_ticks
from rig.loop.wire.layout import Drive, pace, wire_memory
from rig.loop.wire.orders import Segment, control_in, course
from rig.plant.integrator import TICK
from tools.simulated.tracking_guide import TRACKING

from .loop_chain import CHANNELS, CPU, MODEL, PRIORITY, PROPORTIONAL, Chain, fast, wire_tolerances

Array = NDArray[np.float64]

BEGIN_MARK: Final = "<!-- table by make bench-loop: begin -->"
END_MARK: Final = "<!-- table by make bench-loop: end -->"
SPARE_S: Final = 60.0
"""s for which the motion is longer than the measurement."""


@dataclasses.dataclass(eq=False)
class Measured:
    """The measured times of one quantity over all rounds.

    Attributes:
        name: of the quantity, for the table.
        times: an array of times for each round, s.
        ticks: number of ticks of all rounds; 0 where ticks are not counted.
        missed: number of ticks that were missed.
    """

    name: str
    times: list[Array] = dataclasses.field(default_factory=list)
    ticks: int = 0
    missed: int = 0

    def row(self, reference: Array | None) -> tuple[str, ...]:
        """Return the cells of the table's row on the quantity.

        They are the name, p50, p99 and p99.9 in us, the ratios of p50 and p99 to `reference` (2,)
        in s, which are empty if it is None, and the share of missed ticks.
        """
        times = np.concatenate(self.times)
        percentiles = np.percentile(times, (50.0, 99.0, 99.9))
        ratios = ("", "") if reference is None else tuple(
            f"{ours / theirs:.2f}" for ours, theirs in zip(percentiles[:2], reference, strict=False)
        )  # fmt: skip
        missed = f"{100.0 * self.missed / self.ticks:.2f} %" if self.ticks else ""
        return (self.name, *(f"{1e6 * value:.0f}" for value in percentiles), *ratios, missed)


def cyclictest(seconds: float) -> Array:
    """Run cyclictest for a time, and return how late it woke up at each tick, s, to within 1 us.

    The times are sorted, and those above 20 ms are left out.

    Raises:
        CalledProcessError: cyclictest failed.
    """
    command = ["cyclictest", "-m", "-q", "-t1", f"-a{CPU}", f"-p{PRIORITY}", "-i1000",
               f"-l{round(seconds / TICK)}", "-h20000"]  # fmt: skip
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    return histogram_times(ran.stdout)


def histogram_times(text: str) -> Array:
    """Return the times (s) that are counted in a histogram by cyclictest.

    Each line of the histogram has a whole number of us and a count; the middle of the us is taken.
    Lines that do not begin with a digit are left out.
    """
    pairs = [line.split() for line in text.splitlines() if line and line[0].isdigit()]
    micros = np.array([int(pair[0]) for pair in pairs], dtype=np.float64)
    counts = np.array([int(pair[1]) for pair in pairs])
    return np.repeat(1e-6 * (micros + 0.5), counts)


def idle(rig: Rig, seconds: float) -> Array:
    """Run the loop for a time (s) without a device to exchange samples with; return its rows.

    They are (rows, columns), as in `CHANNELS`, the newest of the run.
    """
    board = Board.create(len(CHANNELS))
    board.words[Word.SWITCH] = 1
    spec = fast(rig)
    memory = start_memory("product", MODEL)
    # A plan of another type would make numba compile the loop once more.
    driver = spec.create_fast()

    def run(number: int) -> None:
        planned = course(Segment(number, Drive.NULL, memory, MODEL.parameters))
        wire_ticks(
            planned, control_in(planned),
            compiled_filter(memory, MODEL.parameters),
            interlock(limit_table((), TICK), wire_tolerances(rig, spec)),
            pace(rig.loop, 1.0 / TICK), -1, driver.plan(), driver.look_plan(), wire_memory(),
            board,
        )  # fmt: skip

    def real_time() -> None:
        with RealTime(CPU, PRIORITY):
            run(1)

    run(-1)
    thread = threading.Thread(target=real_time)
    thread.start()
    time.sleep(seconds)
    board.words[Word.SWITCH] = 0
    thread.join()
    return RingReader(board).latest(round(seconds / TICK))


def whole_chain(rig: Rig, seconds: float, control: ControlSettings = PROPORTIONAL) -> Array:
    """Run the loop on an emulated rig with recorder and subscriber for a time, and return its rows.

    `control` is what the position loop adds to gain times error.

    They are (rows, columns), as in `CHANNELS`, for `seconds` of the motion.

    Raises:
        RuntimeError: rows are missing in the recording.
        TrippedError: the loop tripped.
    """
    with Chain(rig, seconds + SPARE_S, control) as chain:
        fd = chain.board.fd
        subscriber = subprocess.Popen(
            [sys.executable, "-m", "tools.bench.loop", "--subscribe", str(fd)], pass_fds=(fd,)
        )
        try:
            rows = chain.rows(round(seconds / TICK))
        finally:
            subscriber.kill()
            subscriber.wait()
        if lacking := chain.finish():
            raise RuntimeError(f"{lacking} rows were not recorded")
    return rows


def subscribe(fd: int) -> None:
    """Turn every row of the board with file descriptor `fd` into JSON; this never returns."""
    reader = RingReader(Board.attach(fd))
    while True:
        for row in reader.take():
            json.dumps(dict(zip(CHANNELS, row.tolist(), strict=True)))


def measure(rounds: int, seconds: float) -> tuple[list[tuple[str, ...]], bool]:
    """Run all rounds; return the table's rows, and whether cyclictest is installed.

    Args:
        rounds: number of rounds.
        seconds: for how long each thing is measured in a round.
    """
    rig = load_rig("emulated")
    theirs = Measured("cyclictest: wake-up")
    alone, woken = Measured("loop idle: wake-up"), Measured("whole chain: wake-up")
    sent = Measured("whole chain: tick to command")
    replied = Measured("whole chain: tick to reply")
    computed = Measured("whole chain: filter, interlock, row")
    tracked = Measured("whole chain, tracking law: tick to command")
    followed = Measured("whole chain, tracking law: filter, interlock, row")
    has_cyclictest = shutil.which("cyclictest") is not None
    for _ in range(rounds):
        if has_cyclictest:
            theirs.times.append(cyclictest(seconds))
        _add(alone, idle(rig, seconds), "wakeup_s")
        chain = whole_chain(rig, seconds)
        _add(woken, chain, "wakeup_s")
        _add(sent, chain, "sent_s")
        _add(replied, chain, "wakeup_s", "exchange_s")
        _add(computed, chain, "compute_s")
        chain = whole_chain(rig, seconds, TRACKING)
        _add(tracked, chain, "sent_s")
        _add(followed, chain, "compute_s")
    reference = None
    if has_cyclictest:
        reference = np.percentile(np.concatenate(theirs.times), (50.0, 99.0))
    measured = ([theirs] if has_cyclictest else []) + [
        alone, woken, sent, replied, computed, tracked, followed
    ]  # fmt: skip
    wakings = (theirs, alone, woken)
    rows = [one.row(reference if one in wakings else None) for one in measured]
    return rows, has_cyclictest


def table(rows: list[tuple[str, ...]], rounds: int, seconds: float) -> str:
    """Return a sentence on the measurement and its table, in Markdown.

    Args:
        rows: see `measure`.
        rounds: number of rounds.
        seconds: for how long each thing was measured in a round.
    """
    heads = ("", "p50, us", "p99, us", "p99.9, us", "p50 ratio", "p99 ratio", "missed")
    lines = [heads, tuple("---" if i == 0 else "---:" for i in range(len(heads))), *rows]
    text = "\n".join(f"| {' | '.join(line)} |" for line in lines)
    load = f"{os.getloadavg()[0]:.1f}"
    machine = f"{os.cpu_count()} processors ({_processor()}), Linux {platform.release()}"
    return (
        f"{rounds} rounds of {seconds:g} s each, interleaved; {machine}; load average at the end "
        f"{load}, this measurement included. Ratios are to cyclictest in the same run.\n\n{text}\n"
    )


def _processor() -> str:
    """Return the name of the processor from /proc/cpuinfo; "unknown" if it has none."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(": ")[1] for line in lines if line.startswith("model name")), "unknown")


def write_page(page: Path, text: str) -> None:
    """Replace the text between the two marks of a page by `text`.

    If the page has no marks, they are added at its end, with `text` between them.
    """
    before, _, rest = page.read_text().partition(BEGIN_MARK)
    _, _, after = rest.partition(END_MARK)
    page.write_text(f"{before}{BEGIN_MARK}\n{text}{END_MARK}{after}")


def _add(measured: Measured, rows: Array, *channels: str) -> None:
    times = np.sum([rows[:, CHANNELS.index(channel)] for channel in channels], axis=0)
    measured.times.append(times[np.isfinite(times)])
    measured.ticks += len(rows)
    measured.missed += int(np.count_nonzero(np.isnan(rows[:, CHANNELS.index("wakeup_s")])))


def main() -> None:
    """Run the benchmark and print its table; with `--page`, write it into that page too."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="how often each is measured")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long, each time")
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--subscribe", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.subscribe is not None:
        subscribe(given.subscribe)
    rows, has_cyclictest = measure(given.rounds, given.seconds)
    text = table(rows, given.rounds, given.seconds)
    if not has_cyclictest:
        text += "\ncyclictest is not installed (Debian: rt-tests), so that there are no ratios.\n"
    print(text)
    if given.page is not None:
        write_page(given.page, text)


if __name__ == "__main__":
    main()
