"""Simulates the tests of a shipped campaign in memory, and lets both detectors judge them."""

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from control.setpoints import Sine
from estimator.filters.registry import DEFAULT_FILTER, start_memory
from estimator.leaks.detection import Decision
from estimator.leaks.pattern import STARTED_S, PatternDetector
from estimator.leaks.replaying import ReplayResult, replay
from faults.campaign import Campaign, CampaignTest
from faults.schedule import Fault
from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.rigs.rig import Rig
from rig.plant import Model
from rig.recording import Recording
from rig.runner.campaign.simulated_bench import loop_of
from rig.runner.outcomes.thresholds import HealthyReferences

from .trusted import TrustedRun, run_trusted


@dataclass(frozen=True)
class Trial:
    """One test of a campaign, run on the simulated rig, with at most one leak.

    Attributes:
        test: the test, as the campaign has it.
        model: the model that filters and detectors assume.
        recording: all channels at 1 kHz, including the truth.
        thesis: replay with the thesis's filter and its pattern, whose thresholds come from the
            healthy test.
        trusted: run of the thesis's filter that trusts the encoder (`tools.thesis_tables.trusted`).
        product: replay with the product filter and the default detector.
    """

    test: CampaignTest
    model: Model
    recording: Recording
    thesis: ReplayResult
    trusted: TrustedRun
    product: ReplayResult

    @property
    def leak(self) -> Fault | None:
        """The leak that was injected; None in a healthy test."""
        return self.test.faults[0] if self.test.faults else None

    @property
    def pattern_before_leak(self) -> Decision | None:
        """The last decision of the thesis's pattern before the leak; None in a healthy test."""
        if self.leak is None:
            return None
        return next(d for t, d in reversed(self.thesis.history) if t < self.leak.at_s)


@dataclass(frozen=True)
class Trials:
    """The trials of a campaign, in its order, and the thesis filter that ran over them."""

    campaign: Campaign
    rig: Rig
    filter_name: str
    trials: tuple[Trial, ...]

    def healthy(self, *, sine: bool = True) -> Trial:
        """Return the first healthy test with a sine as setpoint, or with another if not `sine`.

        Raises:
            StopIteration: there is no such test.
        """
        return next(
            t for t in self.trials if t.leak is None and isinstance(t.test.setpoint, Sine) == sine
        )

    def leaks(self, kind: str, *, sine: bool = True) -> list[Trial]:
        """Return the tests with one kind of leak, smallest leak first.

        `sine` chooses the tests with a sine as setpoint, or else those with another one.
        """
        found = [(t.leak.coefficient, t) for t in self.trials if t.leak and t.leak.kind == kind
                 and isinstance(t.test.setpoint, Sine) == sine]  # fmt: skip
        return [trial for _, trial in sorted(found, key=lambda pair: pair[0])]


def record(rig: Rig, test: CampaignTest, model: Model) -> Recording:
    """Run a test on the simulated rig; return all channels of the loop, including the truth.

    The product filter runs along. The way to the start of the motion is not recorded.
    """
    loop = loop_of(rig, test, start_memory(DEFAULT_FILTER, model, rig.sensors), model)
    loop.position()
    rows = loop.advance(loop.ticks_left)
    return Recording(
        {name: np.ascontiguousarray(rows[:, i]) for i, name in enumerate(loop.channels)}
    )


def run_trials(name: str, filter_name: str, kinds: Collection[str] | None = None) -> Trials:
    """Run the tests of a shipped campaign on the rig that it names.

    Args:
        name: of the campaign.
        filter_name: `thesis-6` or `thesis-7`.
        kinds: kinds of leak whose tests are run, beside the healthy tests; None means all kinds.
    """
    campaign, rig = load_campaign(name)
    if kinds is not None:
        chosen = [t for t in campaign.tests if all(fault.kind in kinds for fault in t.faults)]
        campaign = replace(campaign, tests=tuple(chosen))
    references = HealthyReferences(replace(campaign, filter_name=filter_name))
    trials = {}
    for index in references.running_order:
        test = campaign.tests[index]
        trial = _run(campaign, rig, test, filter_name, references)
        if references.is_reference(test):
            innovation = trial.thesis.run.innovation[trial.recording.time_s > STARTED_S, 1:3]
            references.add(test, innovation)
        trials[index] = trial
    ordered = tuple(trials[index] for index in range(len(campaign.tests)))
    return Trials(campaign, rig, filter_name, ordered)


def _run(
    campaign: Campaign,
    rig: Rig,
    test: CampaignTest,
    filter_name: str,
    references: HealthyReferences,
) -> Trial:
    model = campaign.model
    recording = record(rig, test, model)
    baseline = references.learning(test).baseline
    return Trial(
        test,
        model,
        recording,
        replay(
            recording,
            model,
            filter_name=filter_name,
            detector=PatternDetector(campaign.false_alarms_per_day, baseline),
            sensors=rig.sensors,
        ),
        run_trusted(recording, model, filter_name),
        replay(
            recording,
            model,
            false_alarms_per_day=campaign.false_alarms_per_day,
            sensors=rig.sensors,
        ),
    )
