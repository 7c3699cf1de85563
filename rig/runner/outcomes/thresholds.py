"""Thresholds of the thesis's detector, learnt from the campaign's own healthy tests.

A moving average of innovations depends on the motion and the load: a healthy test says what is
normal for the tests with the same setpoint and load. Where there is none, the detector learns from
the first 15 s of the test itself.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from control import Multisine, Pseudorandom, Setpoint
from estimator.filters import DEFAULT_FILTER, THESIS_WINDOW, FilterRun
from estimator.leaks import (
    LEARNING_S,
    STARTED_S,
    Decision,
    Detector,
    PatternBaseline,
    Samples,
    learn_pattern,
)
from faults import Campaign, CampaignTest, Verdict

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Learning:
    """What a detector is given about the healthy rig, and where that comes from.

    `baseline` is None where the detector learns by itself, or has nothing to learn; what the
    campaign's own baseline says is not in it.
    """

    baseline: PatternBaseline | None
    source: str


class HealthyInnovations:
    """A detector that hands everything on to another and keeps the pressures' innovations."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._pieces: list[Array] = []

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take the next samples."""
        self._detector.update(samples, run)
        self._pieces.append(run.innovation[samples.time_s > STARTED_S, 1:3].copy())

    def decide(self) -> Decision:
        """Return the other detector's decision."""
        return self._detector.decide()

    @property
    def innovations(self) -> Array:
        """Innovations of pressures 1 and 2 since the filter has started, float64 (n, 2) in Pa."""
        return np.concatenate([*self._pieces, np.empty((0, 2))])


@dataclass
class HealthyReferences:
    """What the healthy tests of a campaign say about its others."""

    campaign: Campaign
    _kept: list[tuple[CampaignTest, Array]] = field(default_factory=list, init=False)

    @property
    def running_order(self) -> list[int]:
        """Indices of the campaign's tests, those that others learn from first."""
        tests = self.campaign.tests
        return sorted(range(len(tests)), key=lambda index: not self.is_reference(tests[index]))

    def is_reference(self, test: CampaignTest) -> bool:
        """Return whether other tests may learn from a test."""
        return self._learns and not test.faults and test.expect == Verdict.HEALTHY

    def add(self, test: CampaignTest, innovations: Array) -> None:
        """Keep a healthy test's innovations, float64 (n, 2) in Pa, if they are of use."""
        if len(innovations) >= THESIS_WINDOW and np.isfinite(innovations).all():
            self._kept.append((test, innovations))

    def learning(self, test: CampaignTest) -> Learning:
        """Return what a test learns from healthy tests with the same setpoint and load."""
        if self.campaign.baseline is not None:
            return Learning(None, f"baseline {self.campaign.baseline_file}")
        if not self._learns:
            return Learning(None, "")
        alike = [kept for kept in self._kept if _are_alike(kept[0], test)]
        if not alike or self.is_reference(test):
            return Learning(None, f"first {LEARNING_S:g} s of the test")
        innovations = [innovation for _, innovation in alike]
        baseline = learn_pattern(innovations, self.campaign.false_alarms_per_day)
        return Learning(baseline, _listed(other.name for other, _ in alike))

    @property
    def _learns(self) -> bool:
        return self.campaign.filter_name != DEFAULT_FILTER and self.campaign.baseline is None


def _are_alike(one: CampaignTest, other: CampaignTest) -> bool:
    return _unseeded(one.setpoint) == _unseeded(other.setpoint) and one.load == other.load


def _unseeded(setpoint: Setpoint) -> Setpoint:
    """Return a setpoint without its own seed: others of its kind are the same motion."""
    if isinstance(setpoint, Pseudorandom):
        return replace(setpoint, seed=0)
    if isinstance(setpoint, Multisine) and setpoint.seed is not None:
        return replace(setpoint, seed=0)
    return setpoint


def _listed(names: Iterable[str]) -> str:
    return f"healthy tests: {', '.join(names)}"
