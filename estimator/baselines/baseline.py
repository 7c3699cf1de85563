"""Baselines: what a detector may assume of one rig, learnt from healthy recordings of that rig.

The default detector uses the baseline's estimates of the nuisances (null bias, valve edges,
pressures, oil), so that it can distinguish them from a leak that is present from the first sample,
and, from ten minutes of recordings on, the rig's own noise (`learning`).
The detector of the thesis filters uses the healthy level of the innovations' moving averages.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import DRIFT, NUISANCES, AccountBlock, NuisanceBelief
from estimator.filters import DEFAULT_FILTER, FILTERS
from estimator.leaks import (
    STARTED_S,
    Decision,
    Detector,
    HealthyLevel,
    LeakTest,
    OilAccount,
    OilAccountDetector,
    PatternDetector,
    filter_recording,
    healthy_level,
    replay,
    samples_of,
)
from estimator.learnt import LearntNoise
from rig.plant import Model, model_sha256
from rig.recording import Recording

from .learning import belief_of, learnt_noise

Array = NDArray[np.float64]

PATTERN_FILTERS: Final = tuple(name for name in FILTERS if name != DEFAULT_FILTER)
"""Names of the thesis filters, whose detector compares innovations with their healthy level."""
LEAST_LEARNING_S: Final = 600.0
"""Least length in s of all recordings together from which the rig's noise is learnt. At 100 alarms
a day, the highest rate for which it is judged, ten minutes have 0.7 alarms; less tells nothing of
even that rate."""
LEVEL: Final = 100.0
"""False alarms a day at which recordings are checked for leaks before they may enter a baseline.

The rate is far above the default of 1: recordings last only minutes, so that even at this rate few
healthy ones are refused."""


GREATEST_SEAL_LEAKAGE: Final = 4.0
"""Greatest leakage of a healthy seal, in multiples of the tolerance of its nuisance (`NUISANCES`).

A seal that lets more through counts as a leak, however long it has been so. The estimate for a
sound seal exceeds this by chance once in 30 000."""


class BaselineError(ValueError):
    """Raised where a baseline cannot be learnt or read; `problems` lists the reasons as text."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


@dataclass(frozen=True)
class Accepted:
    """Later healthy recordings that a baseline was learnt on from, after an operator's word.

    Attributes:
        recordings: content hash of each recording, by its name.
        hidden: flow in L/min that each leak of `LEAKS` may now have without being seen against the
            commissioning baseline, by how far the nuisances have moved since then in all, (3,).
    """

    recordings: Mapping[str, str]
    hidden: tuple[float, ...]


@dataclass(frozen=True)
class Baseline:
    """What healthy recordings of one rig say is normal for it.

    Attributes:
        nuisances: mean and covariance of the nuisances, each in units of its tolerance; the
            covariance includes the drift from one recording to another (`DRIFT`).
        levels: healthy level of the innovations of both pressures, by name of the thesis filter.
        recordings: content hash of each recording, by its name.
        model: name of the model that was assumed when the baseline was learnt.
        model_error: factor on what the detector allows for errors of the model of this rig; without
            effect on the test for leaks that stay where there is `noise`.
        model_hash: SHA-256 of that model (`rig.plant.model_sha256`); empty in files from before
            there was one.
        noise: the rig's own noise; None if it was not learnt.
        commissioning: the first baseline, if this one was learnt on from later recordings.
        accepted: what was accepted since then, oldest first.
        unverified: whether the baseline is from a file without a checksum, so that nobody can tell
            whether the file was changed.
    """

    nuisances: NuisanceBelief
    levels: Mapping[str, HealthyLevel]
    recordings: Mapping[str, str] = field(default_factory=dict)
    model: str = ""
    model_error: float = 1.0
    model_hash: str = ""
    noise: LearntNoise | None = None
    commissioning: "Baseline | None" = None
    accepted: tuple[Accepted, ...] = ()
    unverified: bool = False

    def account_detector(self, model: Model, false_alarms_per_day: float) -> OilAccountDetector:
        """Return a new detector of oil accounts that assumes this baseline.

        Raises:
            ValueError: the detector does not take that rate.
        """
        return OilAccountDetector(
            model, false_alarms_per_day, self.nuisances, self.model_error, learnt=self.noise
        )

    def detector(self, filter_name: str, model: Model, false_alarms_per_day: float) -> Detector:
        """Return a new detector for the named filter that assumes this baseline.

        Args:
            filter_name: a name in `FILTERS`; the default filter gets the oil accounts' detector,
                a thesis filter the pattern's.
            model: the model that the filter assumes.
            false_alarms_per_day: alarms that a healthy rig may raise in a day of running.

        Raises:
            KeyError: the baseline has no level of a filter of that name.
            ValueError: the default filter's detector does not take that rate.
        """
        if filter_name == DEFAULT_FILTER:
            return self.account_detector(model, false_alarms_per_day)
        level = self.levels[filter_name]
        return PatternDetector(false_alarms_per_day, level.baseline(false_alarms_per_day))


def learn_baseline(
    recordings: Sequence[Recording], model: Model, *, learn_noise: bool = True
) -> Baseline:
    """Return the baseline learnt from healthy recordings of one rig, with an assumed model.

    Each recording is replayed first with the default detector at `LEVEL` false alarms a day.

    Args:
        recordings: healthy recordings of the rig.
        model: the model that is assumed.
        learn_noise: whether the rig's noise is learnt where the recordings last for
            `LEAST_LEARNING_S` or more in all.

    Raises:
        BaselineError: there is no recording, the verdict on one is not `healthy`, or together they
            show a seal that leaks from the first sample on (`GREATEST_SEAL_LEAKAGE`).
        KeyError: a recording lacks command, position or a pressure.
    """
    if not recordings:
        raise BaselineError(["baseline: no recording; give healthy recordings of the rig"])
    test = LeakTest(LEVEL)
    innovations: dict[str, list[Array]] = {name: [] for name in PATTERN_FILTERS}
    accounts: list[list[AccountBlock]] = []
    problems = []
    for recording in recordings:
        result = replay(recording, model, false_alarms_per_day=LEVEL)
        if result.decision.verdict != "healthy":
            problems.append(not_healthy(recording.source, result.decision))
        account = OilAccount(model.parameters, test)
        accounts.append(list(account.add(samples_of(recording), result.run)))
        for name, series in innovations.items():
            run = filter_recording(recording, model, name)
            started = run.time_s - run.time_s[0] > STARTED_S
            series.append(run.innovation[started, 1:3])
    if problems:
        raise BaselineError(problems)
    learnt = test.nuisances()
    if problems := list(_always_leaking(learnt.mean)):
        raise BaselineError(problems)
    drift = DRIFT**2 * np.eye(len(NUISANCES))
    belief = NuisanceBelief(learnt.mean, learnt.covariance + drift)
    noise = None
    if learn_noise and _seconds(accounts) >= LEAST_LEARNING_S:
        noise = learnt_noise(accounts, model.parameters)
    if noise is not None:
        # The noise was measured with nuisances that were fitted with the same weights.
        belief = belief_of(accounts, noise, model.parameters)
        if problems := list(_always_leaking(belief.mean)):
            raise BaselineError(problems)
    return Baseline(
        belief,
        {name: healthy_level(series) for name, series in innovations.items()},
        {recording.source: recording.content_hash() for recording in recordings},
        model.name,
        model_hash=model_sha256(model),
        noise=noise,
    )


def _seconds(accounts: Sequence[Sequence[AccountBlock]]) -> float:
    blocks = [block for each in accounts for block in each if block.complete]
    return sum(block.end_s - block.start_s for block in blocks)


def not_healthy(source: str, decision: Decision) -> str:
    """Return why a recording may not enter a baseline, with the remedy, in words."""
    remedy = "leave it out, or find the fault first"
    if decision.suspected is not None:
        remedy = f"{decision.suspected} is likely: find the leak, or record for longer"
    elif decision.verdict == "inconclusive":
        remedy = "record a motion of centimetres for some 20 s"
    return f"{source}: the recording is {decision.verdict}, a baseline needs healthy ones; {remedy}"


def _always_leaking(mean: Array) -> Iterator[str]:
    """Yield a message for each seal whose leakage is above `GREATEST_SEAL_LEAKAGE` tolerances.

    `mean` (n,) has the estimates of `NUISANCES` in their order, in units of their tolerances.
    """
    for nuisance, value in zip(NUISANCES, mean, strict=True):
        if nuisance.name.startswith("seal_leakage") and value > GREATEST_SEAL_LEAKAGE:
            yield (
                f"baseline: {nuisance.name}: the recordings say {nuisance.sigma * value:.2g} "
                f"{nuisance.unit}, {value:.1f} times its tolerance (at most "
                f"{GREATEST_SEAL_LEAKAGE:g}); they leak from the first sample on: find the leak"
            )
