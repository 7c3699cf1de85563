"""Runs trials of the detectors on rigs and motions drawn at random, on several cores.

Each finished trial is kept in a file, as one JSON object in a line, so that an interrupted study
goes on where it stopped.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isfinite, sqrt
from pathlib import Path
from typing import Any, Final

import numpy as np

from control import PLAIN
from estimator.accounts.flow import reference_drop
from estimator.leaks.detection import SETTLED_AFTER_S, SILENT, Decision
from estimator.leaks.replaying import replay
from rig.compile_cache import source_key
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, NOMINAL, Model
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.recording import Recording
from tools.kept_trials import kept_trials, run_and_keep
from tools.simulated.drawn_rigs import MIDDLE, drawn_motion, drawn_rig
from tools.simulated.recordings import SETTLE_TICKS, TRUE_LEAKS, recorded
from tools.simulated.tracking_guide import tracking_guide

SETTINGS: Final[Mapping[str, tuple[str, float]]] = {
    "product": ("product", 1.0),
    "product, often": ("product", 1e4),
    "thesis-6": ("thesis-6", 1.0),
}
"""Judges by name: the filter, whose detector judges, and its setting in false alarms a day.

The second is the first with a low threshold, so that small statistics can be seen too.
"""

_DROOPING: Final = (1e12, 3e12)
"""Droop of the supply in trials with a supply leak, Pa/(m^3/s)^2.

On a supply with less droop, a supply leak cannot be noticed at all.
"""
_ROOT: Final = Path(__file__).parents[2]


@dataclass(frozen=True)
class Plan:
    """The description of one trial, from which all of it follows.

    Attributes:
        seed: draws rig, motion and noise.
        fault: one of `rig.plant.FAULTS`; None for a healthy rig.
        size: size of the fault. For a leak it is in L/min at its reference drop (for a supply leak
            at supply pressure), for a blockage in Pa/(m^3/s)^2.
        onset_s, seconds: when the fault begins, and how long the trial lasts.
        spool_sensor, supply_sensor: whether the rig has a sensor of spool and supply pressure.
        judges: names in `SETTINGS` of the judges that judge the trial.
        tracking: whether the tracking law moves the ram, instead of the proportional loop.
    """

    seed: int
    fault: str | None
    size: float
    onset_s: float
    seconds: float
    spool_sensor: bool = True
    supply_sensor: bool = True
    judges: tuple[str, ...] = ("product",)
    tracking: bool = False

    @property
    def key(self) -> str:
        """A text that differs between any two plans."""
        return json.dumps(asdict(self))


@dataclass(frozen=True)
class Judgement:
    """The verdicts of one judge in one trial.

    Attributes:
        held: (time in s, verdict) of the first decision and of each that changed the verdict.
        ratios: statistic divided by threshold, of each decision; there is one in half a second. It
            is 0 where it would not be finite.
        flow, deviation: last estimate of the leak flow and its standard error, L/min; None if the
            last decision names no leak.
    """

    held: tuple[tuple[float, str], ...]
    ratios: tuple[float, ...]
    flow: float | None
    deviation: float | None

    @property
    def verdict(self) -> str:
        """The last verdict."""
        return self.held[-1][1]

    def first_s(self, verdict: str) -> float | None:
        """Return when the judge first came to the verdict `verdict`, s; None if it never did."""
        return next((time for time, held in self.held if held == verdict), None)

    def alarm_s(self) -> float | None:
        """Return when a verdict was first an alarm (not in `SILENT`), s; None if none was."""
        return next((time for time, held in self.held if held not in SILENT), None)


@dataclass(frozen=True)
class Trial:
    """The result of a trial.

    Attributes:
        plan: of the trial.
        loaded: whether the ram worked against a spring.
        flow: true mean magnitude of the leak's flow from 2 s after onset on, L/min; 0 for a healthy
            rig and for a fault of the lines.
        judged: the judgements, by name of the judge.
    """

    plan: Plan
    loaded: bool
    flow: float
    judged: Mapping[str, Judgement]


def coefficient(plan: Plan) -> float:
    """Return the coefficient (SI) of the plan's fault, as the plant takes it.

    The plan must have a fault. A leak's coefficient is in m^3/(s Pa^0.5), a blockage's in
    Pa/(m^3/s)^2.
    """
    if plan.fault == "return_blockage":
        return plan.size
    if plan.fault == "supply_leakage":
        return plan.size * LITRE_PER_MINUTE / sqrt(NOMINAL.supply_pressure)
    return plan.size * LITRE_PER_MINUTE / sqrt(reference_drop(NOMINAL, plan.fault or ""))


def record(plan: Plan) -> tuple[Recording, bool, float]:
    """Simulate a plan; return the recording, and the values `loaded` and `flow` of its `Trial`."""
    rng = np.random.default_rng(plan.seed)
    ticks, onset = round(plan.seconds / TICK), round(plan.onset_s / TICK)
    truth = drawn_rig(rng)
    setpoint, open_loop = drawn_motion(rng, ticks)
    faults = np.zeros((ticks, len(FAULT_COLUMNS)))
    if plan.fault == "supply_leakage":
        truth = truth._replace(supply_droop=rng.uniform(*_DROOPING))
    if plan.fault is not None:
        faults[onset:, FAULT_COLUMNS.index(plan.fault)] = coefficient(plan)
    rig = simulated_rig(
        Model(parameters=truth), plan.seed,
        spool_sensor=plan.spool_sensor, supply_pressure_sensor=plan.supply_sensor,
    )  # fmt: skip
    guide = tracking_guide(setpoint, open_loop) if plan.tracking else PLAIN
    recording = recorded(rig, Motion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS), guide)
    flow = 0.0
    if plan.fault is not None and plan.fault in TRUE_LEAKS:
        leaking = recording[TRUE_LEAKS[plan.fault]][onset + round(SETTLED_AFTER_S / TICK) :]
        flow = float(np.abs(leaking).mean()) / LITRE_PER_MINUTE
    return recording, truth.spring_stiffness > 0.0, flow


def judged(recording: Recording, judge: str) -> Judgement:
    """Replay a recording with filter and detector of a judge in `SETTINGS`; return the judgement.

    Filter and detector assume the nominal model.
    """
    name, rate = SETTINGS[judge]
    result = replay(recording, Model(), filter_name=name, false_alarms_per_day=rate)
    held: list[tuple[float, str]] = []
    for time_s, decision in result.history:
        if not held or decision.verdict != held[-1][1]:
            held.append((time_s, decision.verdict))
    final = result.decision
    return Judgement(
        tuple(held),
        tuple(_ratio(decision) for _, decision in result.history),
        _litres(final.leak_m3_per_s),
        _litres(final.leak_std_m3_per_s),
    )


def _ratio(decision: Decision) -> float:
    ratio = decision.statistic / decision.threshold
    return round(ratio, 4) if isfinite(ratio) else 0.0


def _litres(flow: float | None) -> float | None:
    return None if flow is None else flow / LITRE_PER_MINUTE


def trial(plan: Plan) -> Trial:
    """Simulate a plan, and let each of its judges judge the recording."""
    recording, loaded, flow = record(plan)
    return Trial(plan, loaded, flow, {judge: judged(recording, judge) for judge in plan.judges})


def trials(
    plans: Sequence[Plan],
    kept: Path,
    jobs: int,
    run: Callable[[Plan], Trial] = trial,
) -> list[Trial]:
    """Return the trials of all plans, in their order; run those that are not kept from before.

    Args:
        plans: plans, all different.
        kept: folder for the file of kept trials, whose name changes whenever the sources change.
        jobs: number of processes.
        run: runs one plan.
    """
    kept.mkdir(parents=True, exist_ok=True)
    file = kept / f"trials-{source_key(_ROOT)}.jsonl"
    done = {found.plan.key: found for found in map(_trial_of, kept_trials(file))}
    left = [(plan,) for plan in plans if plan.key not in done]
    done |= {found.plan.key: found for found in run_and_keep(file, "trials", run, left, jobs)}
    return [done[plan.key] for plan in plans]


def _trial_of(fields: Mapping[str, Any]) -> Trial:
    plan = Plan(**{**fields["plan"], "judges": tuple(fields["plan"]["judges"])})
    judgements = {
        judge: Judgement(
            tuple((float(time_s), str(verdict)) for time_s, verdict in entry["held"]),
            tuple(entry["ratios"]),
            entry["flow"],
            entry["deviation"],
        )
        for judge, entry in fields["judged"].items()
    }
    return Trial(plan, fields["loaded"], fields["flow"], judgements)
