"""Detectors on rigs and motions drawn at random: how small a leak they name, and how soon."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LEAKS
from tools.studies.leak_trials import SETTINGS, Plan, Trial

Array = NDArray[np.float64]

ONSET_S: Final = 20.0
"""After the thesis's pattern has learnt what is healthy, 15 s."""
SECONDS: Final = 80.0
SIZES: Final = (0.005, 0.5)
"""L/min, log-uniform."""
POWER: Final = 0.95
NAMES: Final = {"product": "this detector", "thesis-6": "thesis's pattern"}
"""Judges set to one false alarm a day, as they are called in figures and tables."""
_RIDGE: Final = 1e-4
"""Of the fit's slope: keeps it finite where the data are separable."""
_ITERATIONS: Final = 100
_RESAMPLES: Final = 200


def plans(runs: int) -> Iterator[Plan]:
    """Yield as many leaks as healthy rigs, each judged by all judges."""
    for i in range(runs):
        size = float(np.exp(np.random.default_rng([i, 2]).uniform(*np.log(SIZES))))
        yield Plan(2_000_000 + i, LEAKS[i % 3], size, ONSET_S, SECONDS, judges=tuple(SETTINGS))
    for i in range(runs):
        yield Plan(3_000_000 + i, None, 1.0, ONSET_S, SECONDS, judges=tuple(SETTINGS))


def named_after(trial: Trial, judge: str) -> float:
    """Return the time in s from onset to name; inf if never named, or after an earlier alarm."""
    judgement, onset_s = trial.judged[judge], trial.plan.onset_s
    alarm_s = judgement.alarm_s()
    named_s = judgement.first_s(trial.plan.fault or "")
    if alarm_s is None or named_s is None or alarm_s <= onset_s:
        return float("inf")
    return named_s - onset_s


def peak(trial: Trial, judge: str, window_s: float) -> float:
    """Return the greatest ratio of statistic to threshold within a window after the onset."""
    ratios = np.array(trial.judged[judge].ratios)
    times = (np.arange(ratios.size) + 1) * trial.plan.seconds / ratios.size
    onset_s = trial.plan.onset_s
    return float(ratios[(times > onset_s) & (times <= onset_s + window_s)].max())


@dataclass(frozen=True)
class PowerCurve:
    """Chance that a leak is named, logistic in the logarithm of its flow.

    Attributes:
        offset, slope: of the log odds over the flow's natural logarithm (L/min).
    """

    offset: float
    slope: float

    def at(self, flow: Array) -> Array:
        """Return the chance (n,) at some flows (n,), L/min."""
        return np.asarray(1.0 / (1.0 + np.exp(-(self.offset + self.slope * np.log(flow)))))

    def smallest(self, power: float = POWER) -> float:
        """Return the flow in L/min that is named at a given power; inf if none is."""
        if self.slope <= 0.0:
            return float("inf")
        with np.errstate(over="ignore"):
            return float(np.exp((np.log(power / (1.0 - power)) - self.offset) / self.slope))


def power_curve(flows: Array, named: NDArray[np.bool_]) -> PowerCurve:
    """Fit the chance of being named to what was (maximum likelihood, damped Newton steps).

    Args:
        flows: float64 (n,), L/min.
        named: bool (n,).
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
    """Return the flow named within a window at a given power, and its 95 % interval, L/min.

    The interval is that of resampled trials (Efron 1979). inf where no flow that was tried is.
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
    """Return chances of a false alarm and of an alarm within a window, as the threshold falls.

    Returns:
        Both float64 (n,): parts of the healthy trials and of the leaking ones.
    """
    quiet = np.array([peak(trial, judge, window_s) for trial in healthy])
    loud = np.array([peak(trial, judge, window_s) for trial in leaks])
    thresholds = np.unique(np.concatenate([quiet, loud]))[::-1]
    thresholds = thresholds[thresholds > 0.0]
    return (
        np.array([(quiet >= t).mean() for t in thresholds]),
        np.array([(loud >= t).mean() for t in thresholds]),
    )
