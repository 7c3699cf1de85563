"""Time the loop against cyclictest: idle, and with the whole chain on an emulated rig.

`python -m tools.bench_loop` runs, round after round: cyclictest (rt-tests) where it is installed;
the loop with nothing to exchange; the loop with Modbus exchanges, filter, interlock and ring, while
the recorder writes them to disk and a subscriber turns every row into JSON as fast as it can.
`--page FILE` also writes the table into a page, between its marks.
"""

import argparse
import dataclasses
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import start_memory
from rig.compile_cache import use_compile_cache
from rig.configuration.rig import Rig, load_rig
from rig.io.registry import DriverSpec
from rig.io.settings import HomingSettings
from rig.loop.board import Board, Word
from rig.loop.ladder import Cause, explain, limit_table
from rig.loop.orders import Close, Open, Segment
from rig.loop.realtime import RealTime
from rig.loop.ring import RingReader
from rig.loop.tolerances import Tolerances, tolerances
from rig.loop.wire_cycle import wire_ticks
from rig.loop.wire_layout import (
    Drive,
    course,
    estimation,
    interlock,
    pace,
    shared_memory,
    wire_channels,
    wire_memory,
)
from rig.plant import Model
from rig.plant.integrator import TICK
from rig.supervisor.child import Child
from rig.supervisor.recorder import Begin, Finish

Array = NDArray[np.float64]

CPU: Final = 1
PRIORITY: Final = 80
MODEL: Final = Model()
CHANNELS: Final = wire_channels(start_memory("product", MODEL).filter.states, open_loop=False)
BEGIN_MARK: Final = "<!-- table by make bench-loop: begin -->"
END_MARK: Final = "<!-- table by make bench-loop: end -->"

_PATIENCE_S: Final = 180.0
"""How long the loop may take to start: it may have to be compiled."""
_POLL_S: Final = 0.01


@dataclasses.dataclass(eq=False)
class Measured:
    """Times in s of one thing measured, from all rounds."""

    name: str
    times: list[Array] = dataclasses.field(default_factory=list)
    ticks: int = 0
    missed: int = 0

    def row(self, reference: Array | None) -> tuple[str, ...]:
        """Return the table's row: p50, p99 and p99.9 in us, ratios to a reference, missed ticks."""
        times = np.concatenate(self.times)
        percentiles = np.percentile(times, (50.0, 99.0, 99.9))
        ratios = ("", "") if reference is None else tuple(
            f"{ours / theirs:.2f}" for ours, theirs in zip(percentiles[:2], reference, strict=False)
        )  # fmt: skip
        missed = f"{100.0 * self.missed / self.ticks:.2f} %" if self.ticks else ""
        return (self.name, *(f"{1e6 * value:.0f}" for value in percentiles), *ratios, missed)


def cyclictest(seconds: float) -> Array:
    """Return the wake-up lateness that cyclictest measures, s, to the microsecond."""
    command = ["cyclictest", "-m", "-q", "-t1", f"-a{CPU}", f"-p{PRIORITY}", "-i1000",
               f"-l{round(seconds / TICK)}", "-h20000"]  # fmt: skip
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    return histogram_times(ran.stdout)


def histogram_times(text: str) -> Array:
    """Return the times in s that a cyclictest histogram counts: lines of whole us, and count."""
    pairs = [line.split() for line in text.splitlines() if line and line[0].isdigit()]
    micros = np.array([int(pair[0]) for pair in pairs], dtype=np.float64)
    counts = np.array([int(pair[1]) for pair in pairs])
    return np.repeat(1e-6 * (micros + 0.5), counts)


def idle(rig: Rig, seconds: float) -> Array:
    """Return the rows of the loop with nothing to exchange."""
    board = Board.create(len(CHANNELS))
    board.words[Word.SWITCH] = 1
    spec = _fast(rig)
    memory = start_memory("product", MODEL)
    # Another plan's type would be another compilation.
    plan = spec.create().plan()  # type: ignore[attr-defined]

    def run(number: int) -> None:
        wire_ticks(
            course(number, np.empty(0), Drive.NULL), estimation(memory, MODEL.parameters),
            interlock(limit_table((), TICK), _tolerances(rig, spec)),
            pace(rig.loop, 1.0 / TICK), -1, plan, wire_memory(), shared_memory(board),
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


def whole_chain(rig: Rig, seconds: float) -> Array:
    """Return the rows of the loop on an emulated rig, with recorder and subscriber."""
    ticks = round(seconds / TICK)
    with tempfile.TemporaryDirectory() as folder, _emulated() as port:
        spec = _fast(rig)
        spec = dataclasses.replace(spec, options=dataclasses.replace(spec.options, port=port))
        board = Board.create(len(CHANNELS))
        words = board.words
        loop = Child("loop", "rig.supervisor.loop_process", board, Path(folder) / "log")
        recorder = Child("recorder", "rig.supervisor.recorder", board, Path(folder) / "log")
        subscriber = subprocess.Popen(
            [sys.executable, "-m", "tools.bench_loop", "--subscribe", str(board.fd)],
            pass_fds=(board.fd,),
        )
        try:
            words[Word.SWITCH] = 1
            first = Segment(1, Drive.NULL, start_memory("product", MODEL), MODEL.parameters)
            settings = dataclasses.replace(rig.loop, cpu=CPU, priority=PRIORITY)
            loop.send(Open(spec, settings, limit_table((), TICK), _tolerances(rig, spec), first))
            loop.answer(_PATIENCE_S)
            _switch(loop, words, dataclasses.replace(
                first, number=2, valve_enable=True, reset_lamp=True, rearm=True, reset=True
            ))  # fmt: skip
            column = CHANNELS.index("valve_enabled")
            _wait(words, lambda: board.ring[int(words[Word.ROWS]) - 1, column] == 1.0)
            here = board.ring[int(words[Word.ROWS]) - 1, CHANNELS.index("position_m")]
            motion = here + 0.01 * np.sin(2.0 * np.pi * np.arange(ticks) * TICK)
            test = dataclasses.replace(
                first, number=3, drive=Drive.TRACK, setpoint=motion, valve_enable=True
            )
            recorder.send(Begin(3, Path(folder) / "bench.mcap", CHANNELS, {}, time.time_ns()))
            recorder.answer(_PATIENCE_S)
            reader = RingReader(board)
            _switch(loop, words, test)
            rows: list[Array] = []
            while words[Word.TICK] < ticks or words[Word.SEGMENT] != 3:
                rows.append(reader.take())
                _wait(words, lambda: True)
                time.sleep(0.2)
            rows.append(reader.take())
            recorder.send(Finish(ticks))
            recorder.answer(_PATIENCE_S)
            loop.send(Close())
            loop.answer(_PATIENCE_S)
        finally:
            subscriber.kill()
            subscriber.wait()
            recorder.end()
            loop.end()
    found = np.concatenate(rows)
    return found[found[:, CHANNELS.index("segment")] == 3.0]


def subscribe(fd: int) -> None:
    """Turn every row of a board into JSON, for ever: a reader that is never done."""
    reader = RingReader(Board.attach(fd))
    while True:
        for row in reader.take():
            json.dumps(dict(zip(CHANNELS, row.tolist(), strict=True)))


def measure(rounds: int, seconds: float) -> tuple[list[tuple[str, ...]], bool]:
    """Return the table's rows, and whether there was a cyclictest to compare with."""
    rig = load_rig("emulated")
    theirs = Measured("cyclictest: wake-up")
    alone, woken = Measured("loop idle: wake-up"), Measured("whole chain: wake-up")
    sent = Measured("whole chain: tick to command")
    replied = Measured("whole chain: tick to reply")
    computed = Measured("whole chain: filter, interlock, row")
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
    reference = None
    if has_cyclictest:
        reference = np.percentile(np.concatenate(theirs.times), (50.0, 99.0))
    measured = ([theirs] if has_cyclictest else []) + [alone, woken, sent, replied, computed]
    wakings = (theirs, alone, woken)
    rows = [one.row(reference if one in wakings else None) for one in measured]
    return rows, has_cyclictest


def table(rows: list[tuple[str, ...]], rounds: int, seconds: float) -> str:
    """Return the measurement as Markdown."""
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
    """Return the processor's model as the kernel knows it."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    return next((line.split(": ")[1] for line in lines if line.startswith("model name")), "unknown")


def write_page(page: Path, text: str) -> None:
    """Put a table between the marks of a page."""
    before, _, rest = page.read_text().partition(BEGIN_MARK)
    _, _, after = rest.partition(END_MARK)
    page.write_text(f"{before}{BEGIN_MARK}\n{text}{END_MARK}{after}")


def _fast(rig: Rig) -> DriverSpec:
    return next(spec for spec in rig.drivers if spec.kind == "fast")


def _tolerances(rig: Rig, spec: DriverSpec) -> Tolerances:
    return tolerances(
        MODEL.parameters, rig.sensors, frozenset(spec.inputs), TICK, rig.loop.stale_limit,
        rig.homing or HomingSettings(),
    )  # fmt: skip


@contextmanager
def _emulated() -> Iterator[int]:
    """Serve the emulated rig in a process of its own; yield its DAQ's port."""
    command = [str(Path(sys.executable).with_name("rig")), "emulate", "emulated", "--json"]
    for driver in ("daq", "bypass"):
        command += ["--set-port", f"{driver}=0"]
    emulator = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert emulator.stdout is not None
    try:
        yield int(json.loads(emulator.stdout.readline())["ports"]["daq"])
    finally:
        emulator.terminate()
        emulator.wait()
        emulator.stdout.close()


def _switch(loop: Child, words: NDArray[np.int64], segment: Segment) -> None:
    loop.send(segment)
    loop.answer(_PATIENCE_S)
    words[Word.SWITCH] = segment.number


def _wait(words: NDArray[np.int64], done: Callable[[], bool]) -> None:
    until = time.monotonic() + _PATIENCE_S
    while True:
        if words[Word.LOOP_TRIP]:
            raise RuntimeError(explain(Cause(int(words[Word.LOOP_TRIP]))).sentence)
        if done():
            return
        if time.monotonic() > until:
            raise RuntimeError("the emulated rig was not enabled in time")
        time.sleep(_POLL_S)


def _add(measured: Measured, rows: Array, *channels: str) -> None:
    times = np.sum([rows[:, CHANNELS.index(channel)] for channel in channels], axis=0)
    measured.times.append(times[np.isfinite(times)])
    measured.ticks += len(rows)
    measured.missed += int(np.count_nonzero(np.isnan(rows[:, CHANNELS.index("wakeup_s")])))


def main() -> None:
    """Print the table; put it into a page if asked."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="how often each is measured")
    parser.add_argument("--seconds", type=float, default=10.0, help="how long, each time")
    parser.add_argument("--page", type=Path, help="page to put the table into")
    parser.add_argument("--subscribe", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.subscribe is not None:
        subscribe(given.subscribe)
    use_compile_cache()
    rows, has_cyclictest = measure(given.rounds, given.seconds)
    text = table(rows, given.rounds, given.seconds)
    if not has_cyclictest:
        text += "\ncyclictest is not installed (Debian: rt-tests), so that there are no ratios.\n"
    print(text)
    if given.page is not None:
        write_page(given.page, text)


if __name__ == "__main__":
    main()
