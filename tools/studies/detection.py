"""Measures how often the default detector is right, on rigs and motions drawn at random.

`python -m tools.studies.detection --runs 200` simulates 200 healthy rigs, and 200 rigs with a leak
for each of three sizes. Parameters, loads, motions, places and onsets are drawn anew for each run.
The program prints the alarms on healthy rigs and, for each size, how many leaks were named right,
how fast, and how well they were sized. `--rates 1000 250` judges each run twice, as devices that
sample at these rates (Hz) would have recorded it.
"""

import argparse
from dataclasses import dataclass
from typing import Final

import numpy as np
from rich.console import Console
from rich.table import Table

from estimator.leaks.detection import SETTLED_AFTER_S, Decision
from estimator.leaks.replaying import replay
from rig.channels import READINGS
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, LEAKS, Model
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.simulated.drawn_rigs import MIDDLE, drawn_motion, drawn_rig
from tools.simulated.recordings import SETTLE_TICKS, TRUE_LEAKS, recorded

SECONDS: Final = 40.0
SIZES: Final = (0.06, 0.1, 0.3)
"""Sizes of the leaks, L/min: at half the supply pressure, or for internal leaks at 2.5 MPa."""
DROPS: Final = (6.9e6, 6.9e6, 2.5e6)
"""Pressure drops at which the leaks in `LEAKS` have these flows, Pa."""


@dataclass(frozen=True)
class Run:
    """One run and the detector's decision on it.

    Attributes:
        leak: name of the injected leak; None for a healthy rig.
        onset_s: when the leak opened, s; drawn also for a healthy rig.
        true_m3_per_s: mean magnitude of the leak's true flow, from 2 s after its onset on.
        decision: the last decision of the detector.
        detected_at_s: when the detector first came to its last verdict; None if it is no fault.
        alarmed: whether any decision named a fault.
    """

    leak: str | None
    onset_s: float
    true_m3_per_s: float
    decision: Decision
    detected_at_s: float | None
    alarmed: bool


def sampled(recording: Recording, every: int) -> Recording:
    """Return a recording with readings at every `every`-th row only, and NaN in the others.

    Channels that are no readings, such as the command and the truth, stay whole.
    """
    seldom = {name: values.copy() for name, values in recording.channels.items()}
    for name in READINGS:
        between = np.arange(recording.time_s.size) % every != 0
        seldom[name][between] = np.nan
    return Recording(seldom)


def runs_of(seed: int, size: float, spool_sensor: bool, rates: list[int]) -> list[Run]:
    """Simulate one rig, let the detector judge it at each rate, and return one `Run` a rate.

    Args:
        seed: draws rig, motion, place and onset of the leak, and noise.
        size: of the leak, L/min; 0 for a healthy rig.
        spool_sensor: whether the rig has one.
        rates: samples a second, divisors of 1000.
    """
    rng = np.random.default_rng(seed)
    ticks = round(SECONDS / TICK)
    place = int(rng.integers(3))
    onset = int(rng.uniform(12.0, 25.0) / TICK)
    faults = np.zeros((ticks, len(FAULT_COLUMNS)))
    faults[onset:, place] = size * LITRE_PER_MINUTE / np.sqrt(DROPS[place])
    rig = simulated_rig(Model(parameters=drawn_rig(rng)), seed, spool_sensor=spool_sensor)
    setpoint, open_loop = drawn_motion(rng, ticks)
    recording = recorded(rig, Motion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS))
    settled = onset + round(SETTLED_AFTER_S / TICK)
    flow = np.abs(recording[TRUE_LEAKS[LEAKS[place]]][settled:]).mean()
    leak = LEAKS[place] if size else None
    runs = []
    for rate in rates:
        result = replay(sampled(recording, 1000 // rate), Model())
        alarmed = any(held.names_a_fault for _, held in result.history)
        found = result.decision, result.detected_at_s, alarmed
        runs.append(Run(leak, onset * TICK, float(flow), *found))
    return runs


def leak_row(size: float, rate: int, runs: list[Run]) -> tuple[str, ...]:
    """Return the cells of the table's row on one size of leak (L/min) at one rate (Hz).

    They are size, rate, leaks that the last verdict names right, other runs with an alarm, and for
    the leaks named right latency, rms error, and how often the 95 % interval holds the true flow.
    """
    right = [run for run in runs if run.decision.verdict == run.leak]
    wrong = [run for run in runs if run.alarmed and run not in right]
    latency = [run.detected_at_s - run.onset_s for run in right
               if run.detected_at_s is not None]  # fmt: skip
    errors = [(run.decision.leak_m3_per_s or 0.0) - run.true_m3_per_s for run in right]
    covered = [
        run for run in right
        if (run.decision.interval_m3_per_s or (0.0, 0.0))[0] <= run.true_m3_per_s
        <= (run.decision.interval_m3_per_s or (0.0, 0.0))[1]
    ]  # fmt: skip
    if not right:
        return f"{size:.2f}", str(rate), f"0 of {len(runs)}", str(len(wrong)), "-", "-", "-"
    middle, late = np.percentile(latency, [50, 95])
    spread = np.sqrt(np.mean(np.square(errors))) / LITRE_PER_MINUTE
    return (
        f"{size:.2f}",
        str(rate),
        f"{len(right)} of {len(runs)}",
        str(len(wrong)),
        f"{middle:.1f} / {late:.1f}",
        f"{spread:.3f}",
        f"{len(covered)} of {len(right)}",
    )


def main() -> None:
    """Run the study and print the alarms on healthy rigs and the table on leaks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="runs of each kind")
    parser.add_argument("--no-spool", action="store_true", help="rigs without a spool sensor")
    parser.add_argument(
        "--rates", type=int, nargs="+", default=[1000], help="samples a second, divisors of 1000"
    )
    options = parser.parse_args()
    console = Console()

    def by_rate(first_seed: int, size: float) -> list[list[Run]]:
        seeds = range(first_seed, first_seed + options.runs)
        runs = [runs_of(seed, size, not options.no_spool, options.rates) for seed in seeds]
        return [list(column) for column in zip(*runs, strict=True)]

    hours = options.runs * SECONDS / 3600.0
    for rate, healthy in zip(options.rates, by_rate(0, 0.0), strict=True):
        alarms = sum(run.alarmed for run in healthy)
        silent = sum(run.decision.verdict == "healthy" for run in healthy)
        console.print(
            f"{rate} Hz: {options.runs} healthy rigs, {hours:.1f} h: "
            f"{alarms} alarmed, {silent} judged healthy"
        )
    table = Table(title=f"{options.runs} rigs with a leak, by size")
    headings = (
        "L/min",
        "Hz",
        "right",
        "wrong",
        "latency s, 50 / 95 %",
        "rms error L/min",
        "covered",
    )
    for column in headings:
        table.add_column(column, justify="right")
    for number, size in enumerate(SIZES, start=1):
        for rate, runs in zip(options.rates, by_rate(number * 100_000, size), strict=True):
            table.add_row(*leak_row(size, rate, runs))
    console.print(table)


if __name__ == "__main__":
    main()
