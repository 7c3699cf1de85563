"""Runs a large sweep on a Dask cluster, kills a worker, and computes what a million cases take.

`python -m tools.bench.million` writes a sweep of 20 000 cases of 19 s, the shortest that `thesis-7`
can judge, and runs it twice: in one process, and on a Dask cluster of two workers on loopback, one
of which is killed (SIGKILL) once half of the chunks are on disk. It prints whether both tables are
the same and have each case once, the memory of the scheduler and of `rig sweep` as the cases
advance, the bytes that were written, and from these figures what a million cases would take. It
takes some minutes of two processors; `--cases 2000` takes less.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import pyarrow.parquet as pq
from rich.console import Console
from rich.table import Table

from rig.configuration import Sweep, load_sweep
from rig.sweep import chunks_of

TEXT: Final = """\
name: many
description: As many short cases as it takes.
rig: ideal
filter: thesis-7
cases: {cases}
duration: 19 s
longest_step: 1 ms
parameters:
  bulk_modulus: {{uniform: [-15 %, +15 %]}}
  viscous: {{uniform: [-30 %, +30 %]}}
leaks:
  flow: {{log_uniform: [0.05 L/min, 3 L/min]}}
  onset: 15 s
motions:
  - {{type: sine, mean: 0.3 m, amplitude: {{uniform: [0.05 m, 0.2 m]}}, frequency: 0.5 Hz}}
  - {{type: pseudorandom, lower: 0.1 m, upper: 0.5 m, hold_min: 1 s, hold_max: 2 s}}
"""
MILLION: Final = 1_000_000
SHORT_LOG: Final = "DASK_DISTRIBUTED__ADMIN__LOW_LEVEL_LOG_LENGTH"
"""Environment variable by which the scheduler keeps fewer of its messages (docs/sweeps.md)."""
_LOOK_S: Final = 0.25
_MB: Final = 1e6
_SHOWN: Final = 5
"""Number of rows in which the memory is shown as the cases advance."""
_PRODUCT_RATE: Final = 250.0
"""Simulated seconds per second of a processor by `product`, as docs/sweeps.md states them."""
_PRODUCT_S: Final = 40.0
"""Duration of a case of the shipped sweep `detector`, s."""


@dataclass
class Cluster:
    """The processes of a Dask cluster on loopback.

    Attributes:
        address: address of the scheduler.
        scheduler: its process.
        workers: the processes of the workers.
    """

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


@dataclass
class Seen:
    """What was seen of a sweep while it ran.

    Attributes:
        memory: chunks on disk, resident memory of the scheduler, and that of `rig sweep`, bytes.
        killed_at: number of chunks on disk when the worker was killed; None if none was.
        part_bytes: greatest size of all parts together, bytes.
        elapsed_s: wall-clock time of the sweep, start-up included, s.
    """

    memory: list[tuple[int, int, int]] = field(default_factory=list)
    killed_at: int | None = None
    part_bytes: int = 0
    elapsed_s: float = 0.0


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[Cluster]:
    """Start a Dask scheduler and workers on loopback, yield them, and end them.

    The scheduler's file is written to `folder`. Workers may come later than they are yielded.
    """
    file = folder / "scheduler.json"
    common = ["--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", str(file)]
    quiet = subprocess.DEVNULL
    environment = {**os.environ, SHORT_LOG: "20"}

    def started(what: str, *options: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *common, *options]
        return subprocess.Popen(command, stdout=quiet, stderr=quiet, cwd=folder, env=environment)

    scheduler = started("scheduler", "--port", "0")
    found = Cluster("", scheduler, [])
    try:
        while not file.exists() or "address" not in file.read_text(encoding="utf-8"):
            time.sleep(_LOOK_S)
        found.workers += [
            started("worker", "--nthreads", "1", "--no-nanny") for _ in range(workers)
        ]
        found.address = str(json.loads(file.read_text(encoding="utf-8"))["address"])
        yield found
    finally:
        for process in (scheduler, *found.workers):
            process.kill()
            process.wait()


def memory_of(pid: int, what: str = "VmRSS") -> int:
    """Return a memory of a process from /proc, bytes; 0 if the process is gone."""
    try:
        for line in Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines():
            if line.startswith(f"{what}:"):
                return int(line.split()[1]) * 1024
    except OSError:
        pass
    return 0


def watched(command: list[str], out: Path, at: int, on: Cluster | None) -> Seen:
    """Run `rig sweep`, kill a worker once `at` chunks are on disk, and return what was seen.

    Args:
        command: the command line.
        out: folder of the sweep.
        at: number of chunks on disk at which the first worker is killed.
        on: the cluster; None if the sweep runs without, and nothing is killed.

    Raises:
        SystemExit: the command failed.
    """
    seen, begun = Seen(), time.perf_counter()
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while process.poll() is None:
            sizes = []
            for part in (out / "parts").glob("part-*.arrow"):
                try:
                    sizes.append(part.stat().st_size)
                except FileNotFoundError:
                    break
            scheduler = 0 if on is None else memory_of(on.scheduler.pid)
            seen.memory.append((len(sizes), scheduler, memory_of(process.pid)))
            seen.part_bytes = max(seen.part_bytes, sum(sizes))
            if on is not None and seen.killed_at is None and len(sizes) >= at:
                os.kill(on.workers[0].pid, signal.SIGKILL)
                seen.killed_at = len(sizes)
            time.sleep(_LOOK_S)
    seen.elapsed_s = time.perf_counter() - begun
    if process.returncode != 0:
        raise SystemExit(f"rig sweep ended with {process.returncode}")
    return seen


def growth(memory: list[tuple[int, int, int]], of: int, chunks: int) -> float:
    """Return by how much a process's memory grows with each chunk, bytes.

    It is the slope of a line through what was seen from a fifth of the chunks on, before which the
    process still loads its code.

    Args:
        memory: what was seen, as `Seen.memory` has it.
        of: 1 for the scheduler, 2 for `rig sweep`.
        chunks: number of chunks of the sweep.
    """
    seen = [(each[0], each[of]) for each in memory if each[0] >= 0.2 * chunks and each[of]]
    if len(seen) < 2:
        return 0.0
    mean_done = sum(done for done, _ in seen) / len(seen)
    mean_bytes = sum(size for _, size in seen) / len(seen)
    spread = sum((done - mean_done) ** 2 for done, _ in seen)
    together = sum((done - mean_done) * (size - mean_bytes) for done, size in seen)
    return together / spread if spread else 0.0


def show(cases: int, alone: Seen, clustered: Seen, outs: list[Path], console: Console) -> None:
    """Print what was seen, and what a million cases would take.

    Args:
        cases: number of cases.
        alone: what was seen of the sweep in one process.
        clustered: what was seen of it on the cluster.
        outs: folders of both sweeps.
        console: receives the output.
    """
    chunks = len(chunks_of(sweep_of(cases, outs[0].parent)))
    table = Table(title="Memory on the cluster, MB")
    for column in ("chunks on disk", "cases", "scheduler", "rig sweep"):
        table.add_column(column, justify="right")
    running = [each for each in clustered.memory if each[0]]
    for row in range(_SHOWN):
        done, scheduler, own = running[(len(running) - 1) * row // (_SHOWN - 1)]
        sizes = f"{scheduler / _MB:.0f}", f"{own / _MB:.0f}"
        table.add_row(str(done), str(done * cases // chunks), *sizes)
    console.print(table)
    tables = [out / "sweep.parquet" for out in outs]
    numbers = pq.read_table(tables[1], columns=["case"]).column("case").to_pylist()
    is_same = tables[0].read_bytes() == tables[1].read_bytes()
    say = console.print
    say(f"A worker was killed with {clustered.killed_at} of {chunks} chunks on disk.")
    say(f"Each case once: {'yes' if numbers == list(range(cases)) else 'NO'}.")
    say(f"The table is {'the same as' if is_same else 'NOT the same as'} that of one process.")
    in_table = tables[1].stat().st_size
    say(f"Written: {clustered.part_bytes / cases:.0f} bytes a case in parts, which are deleted at "
        f"the end, and {in_table / cases:.0f} in the table.")  # fmt: skip
    say(f"Wall clock, start-up included: {alone.elapsed_s:.0f} s in one process, "
        f"{clustered.elapsed_s:.0f} s on the cluster.")  # fmt: skip
    many = chunks_of(sweep_of(MILLION, outs[0].parent))
    more = MILLION / cases
    of_scheduler, of_sweep = (growth(clustered.memory, of, chunks) * chunks * more for of in (1, 2))
    last = running[-1]
    say(f"A million cases: {len(many)} chunks of {many[0]}.")
    say(f"  scheduler: {last[1] / _MB:.0f} MB, and {of_scheduler / _MB:+.0f} MB by its growth here")
    say(f"  rig sweep: {last[2] / _MB:.0f} MB, and {of_sweep / _MB:+.0f} MB by its growth here, "
        f"and at the end the table, {clustered.part_bytes * more / _MB:.0f} MB")  # fmt: skip
    say(f"  on disk: {(clustered.part_bytes + in_table) * more / 1e9:.2f} GB")
    hours = [alone.elapsed_s * more / 3600.0]
    hours.append(MILLION * _PRODUCT_S / (2.0 * _PRODUCT_RATE) / 3600.0)
    say(f"  time: {hours[0]:.1f} h of one process by thesis-7 at the rate of this run; "
        f"{hours[1]:.1f} h of two by product, with cases of {_PRODUCT_S:g} s at {_PRODUCT_RATE:g} "
        "simulated seconds per second")  # fmt: skip


def sweep_of(cases: int, folder: Path) -> Sweep:
    """Return the sweep with this number of cases; its file is written to `folder`."""
    file = folder / f"many-{cases}.yaml"
    file.write_text(TEXT.format(cases=cases), encoding="utf-8")
    return load_sweep(file)


def main() -> None:
    """Run the sweep twice, and print what was seen."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20_000, help="default 20 000")
    options = parser.parse_args()
    console = Console(width=110)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sweep = sweep_of(options.cases, folder)
        chunks = len(chunks_of(sweep))
        base = [sys.executable, "-m", "rig.cli", "sweep", str(sweep.path), "--json", "--out"]
        outs = [folder / "alone", folder / "clustered"]
        alone = watched([*base, str(outs[0]), "--jobs", "1"], outs[0], chunks, None)
        with cluster(2, folder) as on:
            command = [*base, str(outs[1]), "--cluster", on.address]
            clustered = watched(command, outs[1], chunks // 2, on)
        show(options.cases, alone, clustered, outs, console)


if __name__ == "__main__":
    main()
