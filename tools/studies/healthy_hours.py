"""Measures how often the detector raises an alarm on healthy rigs, simulated in lanes.

`python -m tools.studies.healthy_hours --hours 1000 --false-alarms-per-day 1 --jobs 2 --out DIR`
simulates 1000 hours of rigs drawn at random, half an hour each, in mixed motion with standstills.
An alarm is a verdict that names a fault; after an alarm, the rig's detector starts anew. The
program prints the rate of alarms with its exact 95 % interval, the rate that the detectors are set
to, and the alarms by verdict and by motion. It writes the same to `DIR/summary-RATE.json`.

Each finished group of rigs is kept as a line of a file in `DIR`. An interrupted study goes on where
it stopped, if it is started again with the same sources; other sources have another file.
"""

import argparse
import json
import os
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy import stats

from estimator.accounts.flow import BLOCK_TICKS
from estimator.accounts.noise import checked_model_error
from estimator.accounts.nuisances import UNINFORMED
from estimator.filters.product_lanes import ProductLanes
from estimator.filters.registry import FILTERS, OUTPUTS, FilterRun
from estimator.leaks.detection import OilAccountDetector
from estimator.leaks.oil_account import Samples
from rig.compile_cache import source_key
from rig.lanes import LANES
from rig.plant import Model
from rig.plant.integrator import TICK
from tools.kept_trials import kept_trials, run_and_keep
from tools.simulated.drawn_rigs import MIDDLE, drawn_rig, known_rig, mixed_motion
from tools.simulated.lanes import SimulatedLanes

Array = NDArray[np.float64]

_ASKED: Final = 20
"""A detector that suspects nothing is asked for its verdict once in this many blocks of 0.5 s."""
RUN_S: Final = 1800.0
_DAY_S: Final = 86400.0
_ROOT: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Setting:
    """The settings of a study.

    Attributes:
        rate: number of false alarms a day that the detectors are set to.
        model_error: factor on what the detectors allow for errors of the model; 0 means that they
            take the model for exact.
        known: whether the rigs equal the model in everything but friction and load.
    """

    rate: float
    model_error: float = 1.0
    known: bool = False

    @property
    def name(self) -> str:
        """The part of file names that stands for this setting."""
        allowed = "" if self.model_error == 1.0 else f"-model-error-{self.model_error:g}"
        return f"{self.rate:g}{allowed}{'-known' if self.known else ''}"


@dataclass(frozen=True)
class Alarm:
    """An alarm on a healthy rig.

    Attributes:
        seed: of the rig.
        time_s: time of the alarm from the start of the rig's run.
        verdict: the fault that the detector named.
        onset_s: when the fault began, as the detector estimated it; NaN if it did not.
        motion: name of the motion at that time.
        statistic, threshold: test statistic of the decision, and its threshold.
    """

    seed: int
    time_s: float
    verdict: str
    onset_s: float
    motion: str
    statistic: float
    threshold: float


@dataclass(frozen=True)
class Group:
    """The result of a group of rigs that were simulated side by side in lanes.

    Attributes:
        number: of the group.
        rig_s: simulated time of all rigs together, s.
        wall_s: wall time that each part took, s: simulation, filter, detector.
        verdicts: number of decisions by verdict. Each rig has one decision in ten seconds, and more
            while its detector suspects a fault.
        alarms: the alarms on these rigs.
    """

    number: int
    rig_s: float
    wall_s: dict[str, float]
    verdicts: dict[str, int]
    alarms: list[Alarm]


class Judge:
    """The detector of one rig, which assumes the nominal model and starts anew after each alarm.

    Args:
        seed: of the rig, for alarms and messages.
        rate, model_error: see `Setting`.

    Attributes:
        verdicts: number of decisions by verdict.
    """

    def __init__(self, seed: int, rate: float, model_error: float = 1.0) -> None:
        self._seed, self._setting = seed, (Model(), rate, UNINFORMED, model_error)
        self._detector = OilAccountDetector(*self._setting)
        self._blocks = 0
        self.verdicts: Counter[str] = Counter()

    def take(self, samples: Samples, run: FilterRun, motion: str) -> Alarm | None:
        """Take the next block (0.5 s); return an alarm if a decision names a fault, otherwise None.

        The detector decides once in 20 blocks, and at every block while it suspects a fault.

        Args:
            samples: of the block.
            run: the filter's estimates over the block.
            motion: name of the motion, for the alarm.

        Raises:
            RuntimeError: the detector failed; the message states the rig and the time.
        """
        try:
            self._detector.update(samples, run)
            self._blocks += 1
            # While the detector suspects nothing, it is asked only once in `_ASKED` blocks.
            if not self._detector.accuses and self._blocks % _ASKED != 0:
                return None
            decision = self._detector.decide()
        except Exception as error:
            raise RuntimeError(f"rig {self._seed} at {samples.time_s[-1]:.1f} s") from error
        self.verdicts[decision.verdict] += 1
        if not decision.names_a_fault:
            return None
        self._detector = OilAccountDetector(*self._setting)
        return Alarm(
            self._seed,
            float(samples.time_s[-1]),
            decision.verdict,
            float("nan") if decision.onset_s is None else decision.onset_s,
            motion,
            decision.statistic,
            decision.threshold,
        )


def _stretches(ticks: int) -> Iterator[slice]:
    """Yield the rows of each block; the first has one more, as accounts lie between samples."""
    ends = [0, *range(BLOCK_TICKS + 1, ticks + 1, BLOCK_TICKS)]
    for first, last in pairwise(ends):
        yield slice(first, last)


class Watcher(Protocol):
    """The interface of what watches one rig of a group, block by block."""

    verdicts: Counter[str]

    def take(self, samples: Samples, run: FilterRun, motion: str) -> Alarm | None:
        """Take the next block, as `Judge.take` does; return an alarm, or None if there is none."""


def run_group(
    number: int,
    setting: Setting,
    run_s: float = RUN_S,
    watchers: Sequence[Watcher] | None = None,
) -> Group:
    """Simulate and judge `LANES` rigs, which are drawn by the group's number.

    Args:
        number: of the group; the seeds of its rigs follow from it.
        setting: settings of the detectors and of the rigs to draw.
        run_s: simulated time of each rig, s.
        watchers: one for each rig, in the order of the lanes; None means a `Judge` each.
    """
    seeds = [number * LANES + lane for lane in range(LANES)]
    generators = [np.random.default_rng((seed, 1)) for seed in seeds]
    ticks = round(run_s / TICK) + 1
    rigs = [drawn_rig(generator) for generator in generators]
    if setting.known:
        rigs = [known_rig(rig) for rig in rigs]
    motions = [mixed_motion(generator, ticks) for generator in generators]
    lanes = SimulatedLanes(rigs, seeds, [MIDDLE] * LANES)
    filters = ProductLanes(Model())
    judges = watchers or [Judge(seed, setting.rate, setting.model_error) for seed in seeds]
    alarms, wall = [], np.zeros(3)
    for part in _stretches(ticks):
        clock = [time.perf_counter()]
        setpoint = np.stack([motion.setpoint[part] for motion in motions], axis=1)
        is_open = np.stack([motion.open_loop[part] for motion in motions], axis=1)
        readings = lanes.advance(setpoint, is_open.astype(np.float64))
        clock.append(time.perf_counter())
        states = filters.advance(readings)
        clock.append(time.perf_counter())
        time_s = np.arange(part.start, part.stop) * TICK
        for lane, (judge, motion) in enumerate(zip(judges, motions, strict=True)):
            samples, run = _seen_by(lane, time_s, readings, states)
            alarm = judge.take(samples, run, motion.kind_at(part.stop - 1))
            if alarm is not None:
                alarms.append(alarm)
        clock.append(time.perf_counter())
        wall += np.diff(clock)
    verdicts = sum((judge.verdicts for judge in judges), Counter[str]())
    parts = dict(zip(("simulation", "filter", "detector"), wall.tolist(), strict=True))
    return Group(number, run_s * LANES, parts, dict(verdicts), alarms)


def _seen_by(lane: int, time_s: Array, readings: Array, states: Array) -> tuple[Samples, FilterRun]:
    """Return the samples and filter estimates of the rig in one lane, as its detector takes them.

    Args:
        lane: index of the rig.
        time_s: (ticks,).
        readings: (ticks, 6, LANES), see `LANE_READINGS`.
        states: (ticks, states, LANES) of the filter.
    """
    position, p1, p2, spool, supply, command = np.ascontiguousarray(readings[:, :, lane].T)
    outputs = np.full((time_s.size, len(OUTPUTS)), np.nan)
    estimates = np.ascontiguousarray(states[:, :, lane])
    run = FilterRun(FILTERS["product"], time_s, estimates, outputs, np.empty((0, 0)))
    return Samples(time_s, command, position, p1, p2, spool, supply), run


def poisson_interval(count: int) -> tuple[float, float]:
    """Return the exact 95 % interval of the mean of a Poisson count (Garwood 1936)."""
    lower = float(stats.chi2.ppf(0.025, 2 * count) / 2.0) if count else 0.0
    return lower, float(stats.chi2.ppf(0.975, 2 * count + 2) / 2.0)


def summary_of(groups: Sequence[Group], setting: Setting) -> dict[str, Any]:
    """Return the results of a study, as they are written to its summary file.

    They are hours, rigs and settings; alarms, in all, a day (with exact 95 % interval), by verdict
    and by motion; shares of decisions by verdict; and speeds, in simulated s per wall s.
    """
    alarms = [alarm for group in groups for alarm in group.alarms]
    rig_s = sum(group.rig_s for group in groups)
    days = rig_s / _DAY_S
    low, high = (bound / days for bound in poisson_interval(len(alarms)))
    verdicts = sum((Counter(group.verdicts) for group in groups), Counter[str]())
    wall = sum((Counter(group.wall_s) for group in groups), Counter[str]())
    return {
        "hours": rig_s / 3600.0,
        "rigs": len(groups) * LANES,
        "false_alarms_per_day": setting.rate,
        "model_error": setting.model_error,
        "rigs_are_the_model": setting.known,
        "alarms": len(alarms),
        "alarms_per_day": len(alarms) / days,
        "interval_per_day": [low, high],
        "setting_within_interval": low <= setting.rate <= high,
        "alarms_by_verdict": dict(Counter(alarm.verdict for alarm in alarms).most_common()),
        "alarms_by_motion": dict(Counter(alarm.motion for alarm in alarms).most_common()),
        "decisions": {name: count / verdicts.total() for name, count in verdicts.most_common()},
        "rig_seconds_per_core_second": {
            "all": rig_s / sum(wall.values()),
            **{part: rig_s / seconds for part, seconds in wall.items()},
        },
        "sources": source_key(_ROOT),
    }


def read_groups(file: Path) -> dict[int, Group]:
    """Return the groups that a file holds, by number; {} if the file is missing."""
    groups = {}
    for fields in kept_trials(file):
        alarms = [Alarm(**alarm) for alarm in fields.pop("alarms")]
        groups[fields["number"]] = Group(**fields, alarms=alarms)
    return groups


def study(
    hours: float, setting: Setting, jobs: int, out: Path, run_s: float = RUN_S, first: int = 0
) -> dict[str, Any]:
    """Run the groups that are not kept from before; write and return the summary of all.

    Args:
        hours: simulated time of all rigs together, h; it is rounded up to whole groups.
        setting: settings of the detectors and of the rigs to draw.
        jobs: number of processes.
        out: folder for the file of groups and for the summary.
        run_s: simulated time of each rig, s.
        first: number of the first group; numbers draw the rigs.
    """
    out.mkdir(parents=True, exist_ok=True)
    kept = out / f"groups-{setting.name}-{source_key(_ROOT)}.jsonl"
    numbers = range(first, first + ceil(hours * 3600.0 / (run_s * LANES)))
    done = read_groups(kept)
    left = [(number, setting, run_s) for number in numbers if number not in done]
    # Each core has a process; its small matrices (20 by 20) gain nothing from further threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    found = run_and_keep(kept, "healthy hours", run_group, left, jobs)
    done |= {group.number: group for group in found}
    summary = summary_of([done[number] for number in numbers], setting)
    text = json.dumps(summary, indent=2) + "\n"
    (out / f"summary-{setting.name}.json").write_text(text, encoding="utf-8")
    return summary


def main() -> None:
    """Run the study and print its summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hours", type=float, default=10.0, help="rig-hours (default 10)")
    parser.add_argument("--false-alarms-per-day", type=float, default=1.0, help="the setting")
    parser.add_argument("--first-group", type=int, default=0, help="of rigs drawn (default 0)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default 1)")
    parser.add_argument("--out", type=Path, required=True, help="folder for what was done")
    parser.add_argument(
        "--model-error",
        type=float,
        default=1.0,
        help="factor on what is allowed for errors of the model (default 1; 0: it is exact)",
    )
    parser.add_argument(
        "--known-rigs",
        action="store_true",
        help="rigs that are exactly the model, but for friction and load",
    )
    options = parser.parse_args()
    allowed = checked_model_error(options.model_error)
    setting = Setting(options.false_alarms_per_day, allowed, options.known_rigs)
    found = study(options.hours, setting, options.jobs, options.out, first=options.first_group)
    low, high = found["interval_per_day"]
    console = Console(width=110)
    console.print(
        f"{found['hours']:.0f} h of {found['rigs']} healthy rigs: {found['alarms']} alarms, "
        f"{found['alarms_per_day']:.2f} a day (95 %: {low:.2f} to {high:.2f}); "
        f"set to {found['false_alarms_per_day']:g}"
    )
    for title in ("alarms_by_verdict", "alarms_by_motion"):
        counts = ", ".join(f"{name} {count}" for name, count in found[title].items())
        console.print(f"{title.replace('_', ' ')}: {counts or 'none'}")
    shares = ", ".join(f"{name} {100 * part:.1f} %" for name, part in found["decisions"].items())
    console.print(f"decisions: {shares}")
    rates = found["rig_seconds_per_core_second"]
    console.print("rig-seconds a core-second: "
                  + ", ".join(f"{name} {value:.0f}" for name, value in rates.items()))  # fmt: skip


if __name__ == "__main__":
    main()
