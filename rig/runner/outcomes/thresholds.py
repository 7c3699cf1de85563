"""Learns the thresholds of the thesis's detector from the campaign's own healthy tests.

The detector compares a moving average of innovations, which depends on motion and load, with its
thresholds. These are learnt from healthy tests with the same setpoint and load; if there are none,
the detector learns from the first 15 s of the test itself.
"""

from dataclasses import dataclass, field, replace

import numpy as np

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

from .figures import Array


@dataclass(frozen=True)
class Learning:
    """What a detector is given about the healthy rig from other tests, and its source.

    Attributes:
        baseline: what was learnt from other tests; None if the detector learns by itself, need not
            learn, or has the campaign's own baseline, which is not in here.
        source: in words, what the thresholds come from; empty if the detector needs none.
    """

    baseline: PatternBaseline | None
    source: str


class HealthyInnovations:
    """A detector that passes all samples on to another one, and keeps the pressures' innovations.

    Args:
        detector: the other detector, which makes the decisions.
    """

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._pieces: list[Array] = []

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Pass the next samples on, with the filter's run over them, and keep the innovations.

        Innovations of the first 2 s of the test are left out.
        """
        self._detector.update(samples, run)
        self._pieces.append(run.innovation[samples.time_s > STARTED_S, 1:3].copy())

    def decide(self) -> Decision:
        """Return the other detector's decision."""
        return self._detector.decide()

    @property
    def innovations(self) -> Array:
        """Innovations of pressures 1 and 2 after the first 2 s, so far, float64 (n, 2) in Pa."""
        return np.concatenate([*self._pieces, np.empty((0, 2))])


@dataclass
class HealthyReferences:
    """Collects innovations of a campaign's healthy tests, from which its other tests learn."""

    campaign: Campaign
    _kept: list[tuple[CampaignTest, Array]] = field(default_factory=list, init=False)

    @property
    def running_order(self) -> list[int]:
        """Indices of the campaign's tests in running order; tests to learn from come first."""
        tests = self.campaign.tests
        return sorted(range(len(tests)), key=lambda index: not self.is_reference(tests[index]))

    def is_reference(self, test: CampaignTest) -> bool:
        """Return whether other tests may learn from a test: it moves, has no faults, expects none.

        With the default filter or the campaign's own baseline the result is always False.
        """
        moves = self._learns and test.leak_test is None
        return moves and not test.faults and test.expect == Verdict.HEALTHY

    def add(self, test: CampaignTest, innovations: Array) -> None:
        """Keep a healthy test's innovations, unless they are fewer than 4000 or not all finite.

        Args:
            test: the test.
            innovations: innovations of pressures 1 and 2, Pa, float64 (n, 2).
        """
        if len(innovations) >= THESIS_WINDOW and np.isfinite(innovations).all():
            self._kept.append((test, innovations))

    def learning(self, test: CampaignTest) -> Learning:
        """Return what a test's detector learns from healthy tests with the same setpoint and load.

        Only healthy tests that were added before count; seeds of setpoints may differ. In all other
        cases the baseline of the result is None: without any such test, and for a test that others
        may learn from, the detector learns from the first 15 s of the test itself; with the default
        filter or the campaign's own baseline nothing is learnt.
        """
        if self.campaign.baseline is not None:
            return Learning(None, f"baseline {self.campaign.baseline_file}")
        if not self._learns:
            return Learning(None, "")
        alike = [kept for kept in self._kept if _are_alike(kept[0], test)]
        if not alike or self.is_reference(test):
            return Learning(None, f"first {LEARNING_S:g} s of the test")
        innovations = [innovation for _, innovation in alike]
        baseline = learn_pattern(innovations, self.campaign.false_alarms_per_day)
        return Learning(baseline, f"healthy tests: {', '.join(other.name for other, _ in alike)}")

    @property
    def _learns(self) -> bool:
        return self.campaign.filter_name != DEFAULT_FILTER and self.campaign.baseline is None


def _are_alike(one: CampaignTest, other: CampaignTest) -> bool:
    return _unseeded(one.setpoint) == _unseeded(other.setpoint) and one.load == other.load


def _unseeded(setpoint: Setpoint) -> Setpoint:
    """Return a setpoint with its seed set to zero, so that setpoints with other seeds are equal."""
    if isinstance(setpoint, Pseudorandom | Multisine) and setpoint.seed is not None:
        return replace(setpoint, seed=0)
    return setpoint
