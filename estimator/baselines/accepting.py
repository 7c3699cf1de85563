"""Learns a baseline on from later healthy recordings, after an operator has accepted them.

What has been accepted in all is capped: the commissioning baseline stays in the file, and neither
its nuisances nor its noise may have moved so far since then that a leak is hidden which the default
would claim. A leak that grows slowly is thus refused in the end, however small its steps are.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import DEAD_ZONE, AccountBlock, NuisanceBelief
from estimator.leaks import LeakTest, OilAccount, replay, samples_of
from estimator.learnt import LearntNoise, joined, measured_noise
from rig.plant import LEAKS, LITRE_PER_MINUTE, Model, Parameters
from rig.recording import Recording

from .baseline import LEVEL, Accepted, Baseline, BaselineError, not_healthy
from .learning import MOST_OFTEN, belief_of, hours_by_regime, looks_of, peaks_over, residuals_of

Array = NDArray[np.float64]

MOST_GROWTH: Final = 1.5
"""Greatest growth of the limit at 10 alarms a day since commissioning, as a factor. The smallest
leak that is found grows with it: 0.02 L/min become 0.03."""
_RATE: Final = 10.0
_ACCEPTED: Final = 1.0
"""False alarms a day at which later recordings must be healthy. An hour of a healthy rig is then
refused once in 24 times. At `LEVEL` a rig whose noise was learnt is accused four times an hour, so
that hardly any would be accepted."""


def accepted_onto(baseline: Baseline, recordings: Sequence[Recording], model: Model) -> Baseline:
    """Return a baseline that was learnt on from later healthy recordings of the same rig.

    Each recording is first judged with the commissioning baseline and with the latest, at
    `_ACCEPTED` false alarms a day. With baselines of earlier versions, whose limits are not below
    those for noise, it is judged at `LEVEL`. The levels of the thesis's filters stay those of
    commissioning.

    Args:
        baseline: the baseline so far, with learnt noise.
        recordings: the later recordings.
        model: the model that the baseline was learnt beside.

    Raises:
        BaselineError: the baseline has no learnt noise, a recording is in it already or is not
            healthy, or it would have moved too far since commissioning.
        KeyError: a recording lacks command, position or a pressure.
    """
    noise = baseline.noise
    if noise is None:
        raise BaselineError(
            [
                "baseline: it has no learnt noise to learn on from; make it anew with rig baseline "
                "from ten minutes of healthy recordings or more"
            ]
        )
    first = baseline.commissioning or baseline
    problems: list[str] = []
    accounts: list[list[AccountBlock]] = []
    known = {hash_: name for name, hash_ in baseline.recordings.items()}
    for recording in recordings:
        if (again := known.get(recording.content_hash())) is not None:
            problems.append(f"{recording.source}: is in the baseline already, as {again}")
            continue
        for kept in (baseline,) if first is baseline else (first, baseline):
            level = _ACCEPTED if kept.noise is not None and kept.noise.tail.regimes else LEVEL
            result = replay(recording, model, detector=kept.account_detector(model, level))
            if result.decision.verdict != "healthy":
                problems.append(not_healthy(recording.source, result.decision))
                break
        account = OilAccount(model.parameters, LeakTest(LEVEL, baseline.nuisances))
        accounts.append(list(account.add(samples_of(recording), result.run)))
    if problems:
        raise BaselineError(problems)
    nuisances = belief_of(accounts, noise, model.parameters, baseline.nuisances)
    grown = joined(noise, _later_noise(accounts, baseline.nuisances, noise, model.parameters))
    moved = nuisances.mean - first.nuisances.mean
    hidden = hidden_flows(accounts, moved, grown, model.parameters)
    if problems := list(_too_far(hidden, first.noise or noise, grown)):
        raise BaselineError(problems)
    added = {recording.source: recording.content_hash() for recording in recordings}
    return replace(
        baseline,
        nuisances=nuisances,
        noise=grown,
        recordings={**baseline.recordings, **added},
        commissioning=first,
        accepted=(*baseline.accepted, Accepted(added, tuple(map(float, hidden)))),
    )


def _later_noise(
    accounts: Sequence[Sequence[AccountBlock]],
    expected: NuisanceBelief,
    noise: LearntNoise,
    parameters: Parameters,
) -> LearntNoise:
    """Return the noise and the peaks of later accounts, judged by what was learnt before them."""
    left = [residuals_of(blocks, expected, noise, parameters) for blocks in accounts]
    alarm = noise.tail.limit(MOST_OFTEN)
    looks = [looks_of(blocks, expected, noise, parameters, alarm) for blocks in accounts]
    tail = peaks_over(noise.tail.base, looks, hours_by_regime(accounts, parameters))
    return LearntNoise(measured_noise(left), noise.dead_zone, tail)


def hidden_flows(
    accounts: Sequence[Sequence[AccountBlock]],
    moved: Array,
    noise: LearntNoise,
    parameters: Parameters,
) -> Array:
    """Return the flow of each of `LEAKS`, L/min, that looks like a movement of the nuisances.

    It is that of the leak whose account comes closest to what the movement explains, in weighted
    least squares over the blocks, and 0 where that leak would have to be negative.

    Args:
        accounts: the blocks of each recording.
        moved: change of each nuisance in units of its tolerance, (n,).
        noise: by which the blocks are weighed.
        parameters: the parameters that were assumed.
    """
    crossed, squares, sizes = np.zeros(3), np.zeros(3), np.zeros(3)
    count = 0
    for blocks in accounts:
        for block in blocks:
            if not block.complete or not noise.is_tested(block, parameters):
                continue
            white = noise.whitening(block, parameters)
            shapes = white @ block.faults[:, : len(LEAKS)]
            crossed += shapes.T @ (white @ block.nuisances @ moved)
            squares += (shapes**2).sum(axis=0)
            sizes += block.sizes[: len(LEAKS)]
            count += 1
    seen = squares > 0.0
    coefficients = np.where(seen, crossed, 0.0) / np.where(seen, squares, 1.0)
    return np.asarray(np.maximum(coefficients, 0.0) * sizes / max(count, 1) / LITRE_PER_MINUTE)


def _too_far(hidden: Array, first: LearntNoise, grown: LearntNoise) -> Iterator[str]:
    remedy = (
        "find the leak; if the rig was overhauled instead, make a new baseline with rig baseline "
        "without --onto"
    )
    for leak, flow, most in zip(LEAKS, hidden, DEAD_ZONE, strict=False):
        if flow > most:
            yield (
                f"baseline: {leak}: what was accepted since commissioning could hide "
                f"{flow:.3f} L/min (at most {most:g} in all); {remedy}"
            )
    before, now = first.tail.limit(_RATE), grown.tail.limit(_RATE)
    if now > MOST_GROWTH * before:
        yield (
            f"baseline: noise: the limit at {_RATE:g} alarms a day would be {now:.1f}, "
            f"{now / before:.2f} times that at commissioning (at most {MOST_GROWTH:g}); {remedy}"
        )
