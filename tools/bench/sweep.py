"""Times `rig sweep`, as simulated seconds per second of one core, with and without start-up.

`python -m tools.bench.sweep` runs the shipped sweep of a thousand minutes on all cores, as a user
does. Before each round it runs the closed-loop test of `tools.bench.lanes`, whose rate shows how
fast the machine is at that time. `--cluster` runs the sweep also on a Dask cluster with the same
number of worker processes on loopback, and prints whether the tables are equal. `--against FOLDER`
runs another checkout of this program in turn with this one, and prints the ratio of their rates.
Run that checkout once before, so that its code is compiled.

A rate by the wall clock divides by the time from the first case to the last, times the number of
processes. A rate by the processor divides by the processor time that the processes used, which
other programs hardly change.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from rich.console import Console
from rich.table import Table

from rig.lanes import LANES

from .campaign import RIG_SECONDS
from .lanes import campaign, in_lanes

WANTED: Final = 8000.0
"""The rate that is required on an idle machine, in simulated seconds per wall-second and core."""
_RATES: Final = ("of_process_after_start", "of_process", "of_processor")


def sweep(reference: str, out: Path, *options: str, checkout: Path | None = None) -> dict[str, Any]:
    """Run `rig sweep` as a user does, and return the summary that it prints.

    Args:
        reference: name or path of the sweep.
        out: folder for its results.
        options: further options of the command.
        checkout: folder of another checkout that is run; None runs this one.

    Raises:
        CalledProcessError: the command failed.
    """
    environment = dict(os.environ)
    if checkout is not None:
        # Each checkout must keep its compiled code in its own folder.
        environment.pop("NUMBA_CACHE_DIR", None)
        environment["PYTHONPATH"] = str(checkout)
    command = [sys.executable, "-m", "rig.cli", "sweep", reference, "--out", str(out), "--json"]
    done = subprocess.run(
        [*command, *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        check=True,
        env=environment,
        cwd=checkout,
    )
    summary: dict[str, Any] = json.loads(done.stdout)
    return summary


@contextmanager
def cluster(workers: int, folder: Path) -> Iterator[str]:
    """Start a Dask scheduler and workers on loopback, yield its address, and end them.

    The scheduler's file is written to `folder`. The workers may not have come yet when the address
    is yielded.
    """
    file = folder / "scheduler.json"
    quiet = subprocess.DEVNULL
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--no-dashboard"]
    dask += ["--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file)]
    each = [sys.executable, "-m", "distributed.cli.dask_worker", "--nthreads", "1", "--no-nanny"]
    each += ["--no-dashboard", "--host", "127.0.0.1", "--scheduler-file", str(file)]
    started = [subprocess.Popen(dask, stdout=quiet, stderr=quiet, cwd=folder)]
    try:
        while not file.exists() or "address" not in file.read_text(encoding="utf-8"):
            time.sleep(0.05)
        for _ in range(workers):
            started.append(subprocess.Popen(each, stdout=quiet, stderr=quiet, cwd=folder))
        yield str(json.loads(file.read_text(encoding="utf-8"))["address"])
    finally:
        for process in started:
            process.kill()
            process.wait()


def lanes_alone() -> float:
    """Return the rate of rigs in lanes without a filter: simulated s per s of processor time."""
    return LANES * RIG_SECONDS / in_lanes(campaign, filtered=False)


def measure(reference: str, jobs: int, rounds: int, on_cluster: bool, console: Console) -> None:
    """Run a sweep in several rounds, and on a cluster if `on_cluster`; print the table of rates.

    Args:
        reference: name or path of the sweep.
        jobs: number of processes.
        rounds: number of rounds.
        on_cluster: whether to run it once more on a cluster, and print whether its table is equal.
        console: receives the output.
    """
    found: list[dict[str, Any]] = []
    alone = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lanes_alone()
        for number in range(rounds):
            alone.append(lanes_alone())
            found.append(sweep(reference, folder / f"run-{number}", "--jobs", str(jobs)))
        same = None
        if on_cluster:
            with cluster(jobs, folder) as address:
                found.append(sweep(reference, folder / "cluster", "--cluster", address))
            tables = [folder / run / "sweep.parquet" for run in ("run-0", "cluster")]
            same = tables[0].read_bytes() == tables[1].read_bytes()
    title = f"rig sweep {reference}, {found[0]['cases']} cases by {found[0]['filter']}"
    table = Table(title=f"{title}: rig-seconds per second of one process")
    for column in ("run", "wall, start-up apart", "wall, of chunks", "processor",
                   "of simulation alone", "start-up s", "processes"):  # fmt: skip
        table.add_column(column, justify="left" if column == "run" else "right")
    speed = float(np.median(alone))
    for number, summary in enumerate(found):
        timing = summary["timing"]
        rates = [timing["rig_seconds_per_second"][name] for name in _RATES]
        table.add_row(
            f"{number + 1}" if number < rounds else "cluster",
            *(f"{rate:.0f}" for rate in rates),
            f"{rates[2] / speed:.2f}",
            f"{timing['start_s']:.1f}",
            str(timing["processes"]),
        )
    console.print(table)
    best = max(each["timing"]["rig_seconds_per_second"][_RATES[0]] for each in found)
    console.print(f"Simulation alone, one motion: {speed:.0f} by the processor.")
    console.print(
        f"Best by the wall clock: {best:.0f}; asked for: {WANTED:.0f} on a quiet machine."
    )
    if same is not None:
        console.print(f"The cluster's table is {'the same' if same else 'NOT the same'}.")


def compare(reference: str, jobs: int, rounds: int, other: Path, console: Console) -> None:
    """Run another checkout and this one in each round; print both rates, and their ratios.

    The ratios are this checkout's rate to that of the other one, in the folder `other`.
    """
    this = Path(__file__).resolve().parents[2]
    table = Table(title=f"rig sweep {reference}: rig-seconds per second, another checkout to this")
    for column in ("round", "wall, start-up apart", "ratio", "processor", "ratio"):
        table.add_column(column, justify="right")
    ratios = []
    with tempfile.TemporaryDirectory() as name:
        for number in range(rounds):
            rates: list[tuple[float, float]] = []
            for checkout in (other.resolve(), this):
                out = Path(name) / f"{number}-{len(rates)}"
                summary = sweep(reference, out, "--jobs", str(jobs), checkout=checkout)
                found = summary["timing"]["rig_seconds_per_second"]
                rates.append((found["of_process_after_start"], found["of_processor"]))
            ratios.append([after / before for before, after in zip(*rates, strict=True)])
            cells = [f"{rates[0][i]:.0f} to {rates[1][i]:.0f}" for i in range(2)]
            ratio_texts = [f"{ratio:.2f}" for ratio in ratios[-1]]
            table.add_row(f"{number + 1}", cells[0], ratio_texts[0], cells[1], ratio_texts[1])
    console.print(table)
    wall, processor = np.median(ratios, axis=0)
    console.print(f"Medians of the ratios: {wall:.2f} by the wall clock, {processor:.2f} by the "
                  "processor.")  # fmt: skip


def main() -> None:
    """Run the benchmark that the command line asks for, and print its table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sweep", default="leaks", help="which one (default leaks)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes")
    parser.add_argument("--rounds", type=int, default=3, help="how often it is run")
    parser.add_argument("--cluster", action="store_true", help="on a Dask cluster as well")
    parser.add_argument("--against", type=Path, help="another checkout, to compare with")
    options = parser.parse_args()
    console = Console(width=110)
    if options.against is not None:
        compare(options.sweep, options.jobs, options.rounds, options.against, console)
        return
    measure(options.sweep, options.jobs, options.rounds, options.cluster, console)


if __name__ == "__main__":
    main()
