"""Times campaigns, as simulated seconds per wall-second on one core, and the start of a run.

`python -m tools.bench.campaign` runs one closed-loop test with each filter in turn, and repeats
that for several rounds. The compiled loop consists of plant with bristle friction, sensor noise,
controller and filter. Each round also runs the quickstart campaign with detector and recordings,
once without its report and once with it.

`--against FOLDER` instead runs `rig run quickstart` of another checkout of this program and of this
one in turn, and prints both rates of the tests, both processor times of the whole command, and
their ratios. Run that checkout once before, so that its code is compiled.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from estimator.evidence import KeptAccounts
from estimator.filters.registry import FILTERS, start_memory
from rig.configuration import load_campaign
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import NO_FAULT, Model
from rig.plant.integrator import TICK
from rig.report import write_report
from rig.runner import run_campaign

RIG_SECONDS: Final = 40.0


def loop_alone(filter_name: str) -> None:
    """Run the ticks of one test of 40 s in the loop with a filter, but no detector or recording."""
    model = Model()
    time_s = np.arange(round(RIG_SECONDS / TICK)) * TICK
    setpoint = 0.3 + 0.2 * np.sin(np.pi * time_s + 0.1)
    faults = np.zeros((time_s.size, len(NO_FAULT)))
    motion = Motion(setpoint, False, faults, 0.3, 1000)
    memory = start_memory(filter_name, model)
    loop = SimulatedLoop(simulated_rig(model, 1), motion, memory, model.parameters)
    while loop.ticks_left:
        loop.advance(500)


def whole_campaign() -> None:
    """Run the quickstart campaign with detector and recordings, without its report."""
    campaign, rig = load_campaign("quickstart")
    with tempfile.TemporaryDirectory() as folder:
        run_campaign(campaign, rig, Path(folder) / "run", pace="fast")


def reported_campaign() -> None:
    """Run the quickstart campaign as `rig run` does, and write its report."""
    campaign, rig = load_campaign("quickstart")
    kept = KeptAccounts()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        write_report(run_campaign(campaign, rig, out, pace="fast", kept=kept), out, kept)


def whole_command(checkout: Path) -> tuple[float, float]:
    """Run `rig run quickstart` of a checkout, in a process of its own.

    Returns:
        Rig-seconds per second of wall clock of the tests alone, and the processor time in s of the
        whole command, with start-up and report.

    Raises:
        CalledProcessError: the command failed.
    """
    # Each checkout must keep its compiled code in its own folder.
    environment = {key: value for key, value in os.environ.items() if key != "NUMBA_CACHE_DIR"}
    environment["PYTHONPATH"] = str(checkout)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        command = [sys.executable, "-m", "rig.cli", "run", "quickstart", "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True, env=environment, cwd=checkout)
        tests = json.loads((out / "results.json").read_text(encoding="utf-8"))["tests"]
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used_s = after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime
    return sum(test["recorded_s"] for test in tests) / sum(test["wall_s"] for test in tests), used_s


def compare(rounds: int, other: Path) -> Table:
    """Run another checkout and this one in turn, and return the table of both and their ratios.

    A ratio is above 1 where this checkout is faster.
    """
    this = Path(__file__).resolve().parents[2]
    table = Table(title=f"rig run quickstart: {other} before, this checkout after")
    for column in ("round", "tests, rig-s per wall-s", "ratio", "whole command, CPU-s", "ratio"):
        table.add_column(column, justify="right")
    found = np.array(
        [[whole_command(each) for each in (other.resolve(), this)] for _ in range(rounds)]
    )
    (rate_before, used_before), (rate_after, used_after) = np.moveaxis(found, 0, 2)
    ratios = np.column_stack([rate_after / rate_before, used_before / used_after])
    for number in range(rounds):
        table.add_row(
            f"{number + 1}",
            f"{rate_before[number]:.0f} to {rate_after[number]:.0f}",
            f"{ratios[number, 0]:.2f}",
            f"{used_before[number]:.1f} to {used_after[number]:.1f}",
            f"{ratios[number, 1]:.2f}",
        )
    middle = np.median(ratios, axis=0)
    table.add_row("median", "", f"{middle[0]:.2f}", "", f"{middle[1]:.2f}")
    return table


def _timed(run: Callable[[], object]) -> float:
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def start_up() -> tuple[float, float]:
    """Return the wall times (s) of `rig --help`, and of a process that only runs `first_sample`.

    Raises:
        CalledProcessError: one of the two processes failed.
    """
    command = [str(Path(sys.executable).with_name("rig")), "--help"]
    help_s = _timed(lambda: subprocess.run(command, check=True, capture_output=True))
    code = "import tools.bench.campaign as b; b.first_sample()"
    first_s = _timed(lambda: subprocess.run([sys.executable, "-c", code], check=True))
    return help_s, first_s


def first_sample() -> None:
    """Load the quickstart campaign and run the first tick of its first test."""
    from rig.runner.campaign.simulated_bench import loop_of

    campaign, rig = load_campaign("quickstart")
    memory = start_memory(campaign.filter_name, campaign.model, rig.sensors)
    loop = loop_of(rig, campaign.tests[0], memory, campaign.model)
    loop.position()
    loop.advance(1)


def measure(rounds: int) -> Table:
    """Time every stage once in each round, and return the table of rates (medians and quartiles).

    Before the first round, every stage is run once without being timed, so that it is compiled.
    """
    quickstart_s = load_campaign("quickstart")[0].rig_time_s
    stages: dict[str, tuple[Callable[[], None], float]] = {
        f"loop with {name}": (lambda name=name: loop_alone(name), RIG_SECONDS)  # type: ignore[misc]
        for name in FILTERS
    }
    stages["quickstart: product filter, detector, recordings"] = (whole_campaign, quickstart_s)
    stages["quickstart: the same, and its report"] = (reported_campaign, quickstart_s)
    times: dict[str, list[float]] = {name: [] for name in stages}
    for run, _ in stages.values():
        run()
    for _ in range(rounds):
        for name, (run, _) in stages.items():
            times[name].append(_timed(run))
    table = Table(title=f"Campaign throughput, one core, medians of {rounds} rounds")
    for column in ("what", "rig-s per wall-s", "quartiles", "ns per tick"):
        table.add_column(column, justify="left" if column == "what" else "right")
    for name, (_, rig_seconds) in stages.items():
        rates = rig_seconds / np.array(times[name])
        low, middle, high = np.percentile(rates, [25, 50, 75])
        table.add_row(name, f"{middle:.0f}", f"{low:.0f} to {high:.0f}", f"{1e6 / middle:.0f}")
    return table


def main() -> None:
    """Run the benchmark, and print throughput and start-up times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=7, help="how often each stage is timed")
    parser.add_argument("--against", type=Path, help="another checkout, to compare with")
    options = parser.parse_args()
    rounds, console = options.rounds, Console()
    if options.against is not None:
        console.print(compare(rounds, options.against))
        return
    console.print(measure(rounds))
    starts = np.array([start_up() for _ in range(max(rounds // 2, 2))])
    help_s, first_s = np.median(starts, axis=0)
    console.print(f"rig --help: {help_s:.2f} s; process start to first sample: {first_s:.2f} s")


if __name__ == "__main__":
    main()
