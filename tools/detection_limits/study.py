"""Evaluates how small leaks detectors name, and how soon, on rigs and motions drawn at random."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LEAKS
from tools.studies.leak_trials import SETTINGS, Plan, Trial

Array = NDArray[np.float64]

ONSET_S: Final = 20.0
"""When leaks open, s: after the 15 s in which the thesis's pattern learns what is healthy."""
SECONDS: Final = 80.0
SIZES: Final = (0.005, 0.5)
"""Smallest and largest leak, L/min at its reference drop; sizes are drawn log-uniformly."""
POWER: Final = 0.95
NAMES: Final = {"product": "this detector", "thesis-6": "thesis's pattern"}
"""Judges that are set to one false alarm a day, with their names in figures and tables."""
_RIDGE: Final = 1e-4
"""Ridge penalty of the logistic fit, which keeps the slope finite where the data are separable."""
_ITERATIONS: Final = 100
_RESAMPLES: Final = 200


def plans(runs: int) -> Iterator[Plan]:
    """Yield the plans of `runs` leaks, then of as many healthy rigs; all judges judge each.

    The leaks are in each place in turn, with sizes drawn from `SIZES`.
    """
    for i in range(runs):
        size = float(np.exp(np.random.default_rng([i, 2]).uniform(*np.log(SIZES))))
        yield Plan(2_000_000 + i, LEAKS[i % 3], size, ONSET_S, SECONDS, judges=tuple(SETTINGS))
    for i in range(runs):
        yield Plan(3_000_000 + i, None, 1.0, ONSET_S, SECONDS, judges=tuple(SETTINGS))


def named_after(trial: Trial, judge: str) -> float:
    """Return the time (s) from the onset until a judge first named the leak rightly.

    It is inf if the judge never did so, if it raised any alarm before the onset or at it, and in a
    healthy trial.
    """
    judgement, onset_s = trial.judged[judge], trial.plan.onset_s
    alarm_s = judgement.alarm_s()
    named_s = judgement.first_s(trial.plan.fault or "")
    if alarm_s is None or named_s is None or alarm_s <= onset_s:
        return float("inf")
    return named_s - onset_s


def peak(trial: Trial, judge: str, window_s: float) -> float:
    """Return the greatest ratio of a judge's statistic to its threshold soon after the onset.

    Ratios later than the onset, by at most `window_s` (s), count.

    Raises:
        ValueError: no ratio is within this time.
    """
    ratios = np.array(trial.judged[judge].ratios)
    times = (np.arange(ratios.size) + 1) * trial.plan.seconds / ratios.size
    onset_s = trial.plan.onset_s
    return float(ratios[(times > onset_s) & (times <= onset_s + window_s)].max())


@dataclass(frozen=True)
class PowerCurve:
    """The chance that a leak is named, as a logistic function of the logarithm of its flow.

    Attributes:
        offset, slope: the log odds are offset + slope * ln(flow in L/min).
    """

    offset: float
    slope: float

    def at(self, flow: Array) -> Array:
        """Return the chances (n,) that leaks of given flows (n,), L/min, are named."""
        return np.asarray(1.0 / (1.0 + np.exp(-(self.offset + self.slope * np.log(flow)))))

    def smallest(self, power: float = POWER) -> float:
        """Return the flow (L/min) that is named with probability `power`.

        It is inf if the chance does not rise with the flow.
        """
        if self.slope <= 0.0:
            return float("inf")
        with np.errstate(over="ignore"):
            return float(np.exp((np.log(power / (1.0 - power)) - self.offset) / self.slope))


def power_curve(flows: Array, named: NDArray[np.bool_]) -> PowerCurve:
    """Fit the chance of being named to trials (maximum likelihood by damped Newton steps).

    A slight ridge penalty keeps the slope finite where all larger leaks are named and no smaller.

    Args:
        flows: flow of each leak, float64 (n,), L/min.
        named: whether each leak was named, bool (n,).
    """
    logarithms = np.log(flows)
    middle = logarithms.mean() if flows.size else 0.0
    design = np.column_stack([np.ones(flows.size), logarithms - middle])
    weights = np.zeros(2)
    ridge = np.diag([_RIDGE, _RIDGE])
    for _ in range(_ITERATIONS):
        chance = 1.0 / (1.0 + np.exp(-np.clip(design @ weights, -30.0, 30.0)))
        slope = design.T @ (named - chance) - ridge @ weights
        curvature = (design * (chance * (1.0 - chance))[:, None]).T @ design + ridge
        step = np.linalg.solve(curvature, slope)
        length = float(np.abs(step).max())
        weights = weights + step / max(length, 1.0)
        if length < 1e-6:
            break
    return PowerCurve(float(weights[0] - weights[1] * middle), float(weights[1]))


def smallest_named(
    leaks: Sequence[Trial], judge: str, window_s: float, power: float = POWER
) -> tuple[float, float, float]:
    """Return the smallest flow that a judge names in time, and its 95 % interval, in L/min.

    The result is (flow, low, high). In time means within `window_s` of the onset with probability
    `power`. The interval comes from resampled trials (Efron 1979). A value above `SIZES[1]`, the
    largest leak that is planned, is returned as inf.
    """
    flows = np.array([trial.flow for trial in leaks])
    named = np.array([named_after(trial, judge) <= window_s for trial in leaks])
    rng = np.random.default_rng(0)
    picks = rng.integers(flows.size, size=(_RESAMPLES, flows.size))
    fitted = [power_curve(flows[p], named[p]).smallest(power) for p in picks]
    best = power_curve(flows, named).smallest(power)
    limits = np.quantile(fitted, [0.025, 0.975], method="nearest")
    return tuple(v if v <= SIZES[1] else float("inf") for v in (best, *limits))  # type: ignore[return-value]


def operating_curve(
    healthy: Sequence[Trial], leaks: Sequence[Trial], judge: str, window_s: float
) -> tuple[Array, Array]:
    """Return the chances of a false and of a true alarm as the threshold falls (ROC curve).

    Returns:
        Two arrays, float64 (n,): the shares of the healthy and of the leaking trials whose
        statistic reaches a threshold within `window_s` of the onset. The n thresholds are the
        trials' different peaks above 0, the greatest first.
    """
    quiet = np.array([peak(trial, judge, window_s) for trial in healthy])
    loud = np.array([peak(trial, judge, window_s) for trial in leaks])
    thresholds = np.unique(np.concatenate([quiet, loud]))[::-1]
    thresholds = thresholds[thresholds > 0.0]
    return (
        np.array([(quiet >= t).mean() for t in thresholds]),
        np.array([(loud >= t).mean() for t in thresholds]),
    )
