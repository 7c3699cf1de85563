"""Judges trials of leaks that come and go, and healthy rigs, with the product's detector."""

from collections import Counter
from dataclasses import dataclass

from estimator.filters.registry import FilterRun
from estimator.leaks import (
    Decision,
    OilAccountDetector,
    Samples,
    filter_recording,
    judged,
    replay,
    samples_of,
)
from rig.plant import LITRE_PER_MINUTE, Model
from tools.intermittent.trials import LEAST_MEAN, Plan, simulated
from tools.studies.healthy_hours import Alarm, Judge
from tools.studies.leak_trials import Plan as StayingPlan, record

LEAST_OPENINGS = 6
"""Fewest openings of 1 s or more of a trial that counts."""


@dataclass(frozen=True)
class Outcome:
    """What a trial was and what the detector made of it; flows are in L/min.

    Attributes:
        seed, number, leak, gate, independent: of the plan; `leak` is None for a healthy rig.
        seconds: length of the recording.
        openings, duty, flow: the truth: openings of 1 s or more, share of time open from the first
            opening on, and mean flow while open.
        verdict: the final verdict.
        intermittent: whether the final verdict says that the leak comes and goes.
        named_s: when that was first said of any leak, s; None if it never was.
        alarmed: whether any decision named a fault.
        found_openings, found_duty, duty_low, duty_high: by the final verdict; 0 if it is of no leak
            that comes and goes.
        found_flow, flow_low, flow_high: likewise.
        goes_with: what the final verdict says it goes with; None for nothing.
    """

    seed: int
    number: int
    leak: str | None
    gate: str
    independent: bool
    seconds: float
    openings: int
    duty: float
    flow: float
    verdict: str
    intermittent: bool
    named_s: float | None
    alarmed: bool
    found_openings: int = 0
    found_duty: float = 0.0
    duty_low: float = 0.0
    duty_high: float = 0.0
    found_flow: float = 0.0
    flow_low: float = 0.0
    flow_high: float = 0.0
    goes_with: str | None = None

    @property
    def counts(self) -> bool:
        """Return whether the trial is within the condition that the trials are for."""
        enough = self.openings >= LEAST_OPENINGS and self.duty * self.flow >= LEAST_MEAN
        return self.leak is not None and enough

    @property
    def right(self) -> bool:
        """Return whether the leak is on record under its name, as one that comes and goes."""
        return self.intermittent and self.verdict == self.leak


def judge(plan: Plan, seconds: float, rate: float, model_error: float) -> Outcome:
    """Simulate a plan, and return what the product's detector makes of it.

    Args:
        plan: the plan.
        seconds: length of the recording.
        rate: false alarms a day that the detector is set to.
        model_error: factor on what it allows for errors of the model.
    """
    course = simulated(plan, seconds)
    detector = OilAccountDetector(Model(), rate, model_error=model_error)
    history = replay(course.recording, Model(), detector=detector).history
    final = history[-1][1]
    named = (time_s for time_s, decision in history if decision.returns is not None)
    return Outcome(
        plan.seed, plan.number, plan.leak, plan.gate, plan.independent, seconds,
        course.openings, course.duty, course.mean_flow, final.verdict,
        final.returns is not None, next(named, None),
        any(decision.names_a_fault for _, decision in history), *_figures(final),
    )  # fmt: skip


def _figures(final: Decision) -> tuple[int, float, float, float, float, float, float, str | None]:
    found = final.returns
    if found is None or final.interval_m3_per_s is None or final.leak_m3_per_s is None:
        return 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None
    low, high = (bound / LITRE_PER_MINUTE for bound in final.interval_m3_per_s)
    return (
        found.openings, found.duty, *found.duty_interval,
        final.leak_m3_per_s / LITRE_PER_MINUTE, low, high,
        None if found.goes_with is None else found.goes_with.what,
    )  # fmt: skip


@dataclass(frozen=True)
class Steady:
    """A trial with a leak that stays, judged with and without the test for returns.

    Attributes:
        seed, leak, flow: of the plan; the flow is in L/min at its reference drop.
        same: whether all decisions were the same.
        renamed: whether any decision said that the leak comes and goes.
    """

    seed: int
    leak: str | None
    flow: float
    same: bool
    renamed: bool


def judge_steady(plan: StayingPlan) -> Steady:
    """Return whether the test for returns changes any decision on a leak that stays."""
    recording, _, _ = record(plan)
    run, samples = filter_recording(recording, Model()), samples_of(recording)
    without, with_it = (
        list(judged(samples, run, OilAccountDetector(Model(), returning=returning)))
        for returning in (False, True)
    )
    renamed = any(decision.returns is not None for _, decision in with_it)
    return Steady(plan.seed, plan.fault, plan.size, without == with_it, renamed)


class ReturnsJudge(Judge):
    """A judge of a healthy rig that counts which of its alarms are of leaks that come and go.

    Attributes:
        alarms: number of alarms of faults that stay ("stays") and that come and go ("returns").
    """

    def __init__(self, seed: int, rate: float, model_error: float) -> None:
        super().__init__(seed, rate, model_error)
        self.alarms: Counter[str] = Counter()

    def take(self, samples: Samples, run: FilterRun, motion: str) -> Alarm | None:
        """Take the next block as `Judge.take` does; note whether an alarm is of a return."""
        before = self._detector
        alarm = super().take(samples, run, motion)
        if alarm is not None:
            returns = before.decide().returns is not None
            self.alarms["returns" if returns else "stays"] += 1
        return alarm
