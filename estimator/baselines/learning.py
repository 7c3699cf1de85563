"""Learns the noise of one rig from its healthy accounts, each part judged by what the others say.

The accounts are divided into folds of whole recordings, or of pieces of them. Noise by regime comes
from what is left of every fold when the nuisances of the other folds are expected. The test itself
is then run over every fold, with the nuisances and the noise of the others. Its peaks over a limit
that they exceed some 20 times an hour say how often higher limits are exceeded
(`estimator.learnt.tail`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil, inf
from typing import Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    DRIFT,
    FAULT_COUNT,
    NUISANCE_COUNT,
    UNINFORMED,
    AccountBlock,
    AccountSums,
    NuisanceBelief,
    Regression,
    dead_zones,
    spool_flow,
)
from estimator.leaks import MINIMUM_BLOCKS, RIVAL_GAIN, LearntLeakTest
from estimator.learnt import (
    LEAST_BASE,
    NEAR_STOP,
    STANDSTILL,
    LearntNoise,
    RegimeNoise,
    Residuals,
    Tail,
    careful,
    measured_noise,
    regime_of,
    tail_of,
)
from rig.plant import LEAKS, LITRE_PER_MINUTE, Parameters

Array = NDArray[np.float64]
Blocks = Sequence[AccountBlock]
_Each = TypeVar("_Each")

WINDOW: Final = 60
"""Blocks (half a minute) over which a persistent error is looked for: a leak of 0.03 L/min or less
takes up to a minute to be named, and motions change within a minute or so."""
FOLDS: Final = 3
"""Number of folds: each is judged by two thirds of the accounts, nearly as many as in the end."""
LEAST_FOLD_S: Final = 60.0
"""Least length of a fold, s."""
PEAKS_AN_HOUR: Final = 20.0
"""Number of peaks of the statistic in an hour from whose base on higher ones are extrapolated. The
statistic of a healthy rig changes with the motion, about every minute, so that every third rise
counts: those are high enough for nearly exponential excesses. At 100 alarms a day an hour has four,
at 10 a day 0.4, a fiftieth of that number; 20 peaks tell the logarithm of how steeply it falls to a
fifth."""
MOST_OFTEN: Final = 100.0
"""Alarms a day after each of which the test begins anew while peaks are counted, as it does in use:
in the minutes after that the nuisances are less sure, and peaks are twice as frequent. It is the
most frequent of the rates that a baseline states (`STATED_RATES`)."""
LEAST_PEAKS: Final = 10
"""Fewest peaks from which higher ones are extrapolated, in a baseline of less than half an hour."""
_BASE_STEP: Final = 0.1
"""Step in which the base is looked for; the mean excess is 0.2 to 0.6."""
_EVERY: Final = 2
"""The statistic is looked at once in this many blocks; it changes little within a second."""
_LONGEST: Final = 120
"""Blocks (one minute) after which a peak ends, and another one begins if the statistic stays."""
_ROUNDS: Final = 2
"""Rounds of fitting the nuisances and measuring the noise. The first weighs the blocks by what the
default allows for, the second by the noise that the first has measured."""


def learnt_noise(recordings: Sequence[Blocks], parameters: Parameters) -> LearntNoise | None:
    """Return what healthy accounts of one rig say of its noise; None if they are too short.

    Args:
        recordings: the blocks of each recording, in order.
        parameters: the parameters that were assumed.
    """
    folds = folds_of(recordings)
    if len(folds) < 2:
        return None
    others = [_others(folds, k) for k in range(len(folds))]
    noises = [_bare({}) for _ in folds]
    for _ in range(_ROUNDS):
        noises = [
            replace(noise, spool_correction=spool_correction_of(rest, noise, parameters))
            for rest, noise in zip(others, noises, strict=True)
        ]
        beliefs = [
            belief_of(rest, noise, parameters) for rest, noise in zip(others, noises, strict=True)
        ]
        left = [
            [residuals_of(blocks, belief, noise, parameters) for blocks in fold]
            for fold, belief, noise in zip(folds, beliefs, noises, strict=True)
        ]
        noises = [
            replace(noise, regimes=measured_noise(_others(left, k)))
            for k, noise in enumerate(noises)
        ]
    noises = [
        replace(noise, dead_zone=dead_zone_of(_others(left, k), noise, parameters))
        for k, noise in enumerate(noises)
    ]
    every = [each for fold in left for each in fold]
    # The test that is used must be as careful as those whose peaks are counted: with all blocks to
    # learn from it would have smaller dead zones and less noise, and go further than they did.
    counted = (len(folds) - 1) / len(folds)
    learnt = _bare(measured_noise(every, counted))
    learnt = replace(learnt, dead_zone=dead_zone_of(every, learnt, parameters, counted))
    correction = spool_correction_of(recordings, learnt, parameters)
    hours, alarm = hours_by_regime(recordings, parameters), inf
    # The first round, without alarms, says at which limit they come as often as they may.
    for _ in range(_ROUNDS):
        looks = [
            looks_of(blocks, belief, noise, parameters, alarm)
            for fold, belief, noise in zip(folds, beliefs, noises, strict=True)
            for blocks in fold
        ]
        tail = peaks_over(base_of(looks, sum(hours.values())), looks, hours)
        alarm = tail.limit(MOST_OFTEN)
    return replace(learnt, tail=tail, spool_correction=correction)


def folds_of(recordings: Sequence[Blocks]) -> list[list[Blocks]]:
    """Return the accounts in `FOLDS` folds, or fewer: recordings if there are enough, else pieces.

    A piece has at least `LEAST_FOLD_S`. Pieces go to the folds in turn.
    """
    pieces: list[Blocks] = [list(blocks) for blocks in recordings if blocks]
    if len(pieces) < FOLDS:
        parts = ceil(FOLDS / max(len(pieces), 1))
        pieces = [part for blocks in pieces for part in _parts(blocks, parts)]
    count = min(FOLDS, len(pieces))
    return [pieces[k::count] for k in range(count)]


def _parts(blocks: Sequence[AccountBlock], parts: int) -> list[list[AccountBlock]]:
    seconds = blocks[-1].end_s - blocks[0].start_s
    parts = max(min(parts, int(seconds / LEAST_FOLD_S)), 1)
    ends = np.linspace(0, len(blocks), parts + 1).astype(int)
    return [list(blocks[a:b]) for a, b in pairwise(ends)]


def _others(folds: Sequence[Sequence[_Each]], left_out: int) -> list[_Each]:
    return [each for k, fold in enumerate(folds) if k != left_out for each in fold]


def dead_zone_of(
    left: Sequence[Residuals],
    noise: LearntNoise,
    parameters: Parameters,
    counted: float = 1.0,
) -> tuple[float, ...]:
    """Return the flow in L/min that each of `FAULTS` must exceed, by what stays for half a minute.

    Errors of the model that come with a kind of motion look like a small leak for as long as it
    lasts, and would be surer the longer it does. What they are taken for is found by fitting each
    leak to every `WINDOW` blocks of what the nuisances leave. The variance of these flows beyond
    their chance is that of a persistent error. The default's dead zone is the prior of its standard
    deviation, with the weight of one window (`careful`). Standstills do not count: what stays for
    one is in the noise of that regime. Supply and return have what they have for an exact model.

    Args:
        left: what the nuisances leave of each recording.
        noise: by which the blocks are weighed.
        parameters: the parameters that were assumed.
        counted: part of the windows that count where few windows are reason for care.
    """
    squares, count = np.zeros(len(LEAKS)), 0
    for recording in left:
        rows = [
            (block, noise.whitening(block, parameters), error)
            for block, name, error in zip(
                recording.blocks, recording.regimes, recording.left, strict=True
            )
            if name not in (NEAR_STOP, STANDSTILL)
        ]
        for first in range(0, len(rows) - WINDOW + 1, WINDOW):
            window = rows[first : first + WINDOW]
            squares += _persistent(window)
            count += 1
    default = np.array(dead_zones(1.0)[: len(LEAKS)])
    variances = np.maximum(squares, 0.0) / max(count, 1) / default**2
    zones = default * np.sqrt([careful(variance, counted * count) for variance in variances])
    return (*map(float, np.minimum(zones, default)), *map(float, dead_zones(0.0)[len(LEAKS) :]))


def _persistent(window: Sequence[tuple[AccountBlock, Array, Array]]) -> Array:
    """Return the square of the flow, (L/min)^2, of each leak in a window, less its chance: (3,).

    Chance is the variance of the fitted coefficient by Eicker, Huber and White, for noise that
    differs from block to block.

    Args:
        window: blocks, the matrix that whitens each, and what the nuisances leave of it.
    """
    shapes = np.array([white @ block.faults[:, : len(LEAKS)] for block, white, _ in window])
    errors = np.array([white @ error for _, white, error in window])
    information = (shapes**2).sum(axis=(0, 1))
    seen = np.where(information > 0.0, information, np.inf)
    coefficients = (shapes * errors[:, :, None]).sum(axis=(0, 1)) / seen
    scores = (shapes * (errors[:, :, None] - shapes * coefficients)).sum(axis=1)
    chance = (scores**2).sum(axis=0) / seen**2
    sizes = np.mean([block.sizes[: len(LEAKS)] for block, _, _ in window], axis=0)
    return np.asarray((coefficients**2 - chance) * (sizes / LITRE_PER_MINUTE) ** 2)


def _bare(regimes: Mapping[str, RegimeNoise]) -> LearntNoise:
    """Return learnt noise without a tail, with the dead zones of an exact model."""
    return LearntNoise(regimes, tuple(map(float, dead_zones(0.0))), Tail(LEAST_BASE, 1.0, 0, 0.0))


def spool_correction_of(
    recordings: Sequence[Blocks], noise: LearntNoise, parameters: Parameters
) -> float:
    """Return the part of the spool's departures by which the accounts are to be corrected, 0 to 1.

    It is the coefficient of `spool_flow` in a regression of all blocks on it and the nuisances,
    with a prior of standard deviation 1. It is kept within 0 to 1. Less than 0 would trust the
    command more than the filter does, and a valve that begins to stick would pass for a leak; more
    than 1 would go beyond the readings.

    Args:
        recordings: the blocks of each recording, not corrected.
        noise: by which the blocks are weighed.
        parameters: the parameters that were assumed.
    """
    sums = _sums(recordings, UNINFORMED, noise, parameters, correct=False)
    if not sums.blocks:
        return 0.0
    squares, products, total = sums.nuisances()
    variance = Regression(squares, products, total, 2 * sums.blocks, 1.0).variance
    departures = sums.faults_since()
    crossed = departures.crossed[0, 0]
    part = np.linalg.solve(squares + variance * np.eye(NUISANCE_COUNT), crossed)
    information = departures.squares[0, 0, 0] - part @ crossed
    projection = departures.products[0, 0] - part @ products
    return float(np.clip(projection / (information + variance), 0.0, 1.0))


def belief_of(
    recordings: Sequence[Blocks],
    noise: LearntNoise,
    parameters: Parameters,
    expected: NuisanceBelief = UNINFORMED,
) -> NuisanceBelief:
    """Return the nuisances by all blocks of healthy recordings, with the drift between recordings.

    Args:
        recordings: the blocks of each recording.
        noise: by which the blocks are weighed.
        parameters: the parameters that were assumed.
        expected: the nuisances before these recordings.
    """
    mean, covariance = _regression(recordings, expected, noise, parameters).nuisances()
    root = np.linalg.cholesky(expected.covariance)
    drift = DRIFT**2 * np.eye(NUISANCE_COUNT)
    return NuisanceBelief(expected.mean + root @ mean, root @ covariance @ root.T + drift)


def residuals_of(
    blocks: Blocks, expected: NuisanceBelief, noise: LearntNoise, parameters: Parameters
) -> Residuals:
    """Return what is left of a recording's complete blocks after a fit of the nuisances.

    Args:
        blocks: the blocks of the recording.
        expected: the nuisances before the fit.
        noise: by which the blocks are weighed.
        parameters: the parameters that were assumed.
    """
    kept = [block for block in blocks if block.complete]
    mean, _ = _regression([blocks], expected, noise, parameters).nuisances()
    nuisances = expected.mean + np.linalg.cholesky(expected.covariance) @ mean
    left = np.array(
        [noise.corrected(block).missing - block.nuisances @ nuisances for block in kept]
    )
    regimes = [regime_of(block, parameters) for block in kept]
    return Residuals(kept, regimes, left.reshape(-1, 2), noise.spool_correction)


def _regression(
    recordings: Sequence[Blocks],
    expected: NuisanceBelief,
    noise: LearntNoise,
    parameters: Parameters,
) -> Regression:
    sums = _sums(recordings, expected, noise, parameters)
    squares, products, total = sums.nuisances()
    return Regression(squares, products, total, 2 * sums.blocks, 1.0)


def _sums(
    recordings: Sequence[Blocks],
    expected: NuisanceBelief,
    noise: LearntNoise,
    parameters: Parameters,
    correct: bool = True,
) -> AccountSums:
    """Return the sums of all tested blocks, with `spool_flow` in the place of the first fault.

    Args:
        recordings: the blocks of each recording, not corrected.
        expected: the nuisances before these recordings.
        noise: by which the blocks are weighed and, if `correct`, corrected.
        parameters: the parameters that were assumed.
        correct: whether the missing flows are corrected.
    """
    sums, root = AccountSums(), np.linalg.cholesky(expected.covariance)
    for blocks in recordings:
        for block in blocks:
            if not block.complete or not noise.is_tested(block, parameters):
                continue
            white = noise.whitening(block, parameters)
            nuisances = white @ block.nuisances
            counted = noise.corrected(block) if correct else block
            missing = white @ counted.missing - nuisances @ expected.mean
            departure = np.zeros((2, FAULT_COUNT + 1))
            departure[:, 0] = white @ spool_flow(block)
            sums.add(block, (missing, nuisances @ root, departure))
    return sums


class Look(NamedTuple):
    """What the test for leaks says after a block.

    Attributes:
        statistic: the greatest statistic of a fault; 0 if it is below `LEAST_BASE`, or if there are
            too few blocks.
        regime: regime of the block.
    """

    statistic: float
    regime: str


class _LowTest(LearntLeakTest):
    """A test with the lowest limit, which tells how high the limit could be for an alarm."""

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        return LEAST_BASE

    def statistic(self) -> float:
        """Return the greatest statistic of a fault, or of a leak that grows; 0 if there is none."""
        found = [self.best(), *self._slow()]
        if self.candidates().gain.max() >= RIVAL_GAIN:
            # Only then are pairs and ramps looked for.
            found += self.search()
        return max((finding.statistic for finding in found if finding is not None), default=0.0)


def looks_of(
    blocks: Blocks,
    expected: NuisanceBelief,
    noise: LearntNoise,
    parameters: Parameters,
    alarm: float,
) -> list[Look]:
    """Return what the test says of a recording, once in `_EVERY` blocks.

    After an alarm, at the end of the peak, the test begins anew.

    Args:
        blocks: the blocks of the recording.
        expected: the nuisances before any block.
        noise: what was learnt of the rig by other accounts.
        parameters: the parameters that were assumed.
        alarm: statistic that an alarm has to exceed; inf for no alarm.
    """

    def begun() -> _LowTest:
        return _LowTest(1.0, expected, noise, parameters)

    test, looks, since = begun(), [], 0
    for number, block in enumerate(blocks):
        test.add(block)
        if number % _EVERY:
            continue
        statistic = test.statistic() if test.blocks >= MINIMUM_BLOCKS else 0.0
        looks.append(Look(statistic, regime_of(block, parameters)))
        over = statistic > alarm
        if since and (not over or since >= _LONGEST):
            test, since = begun(), 0
        elif over:
            since += _EVERY
    return looks


def base_of(recordings: Sequence[Sequence[Look]], hours: float) -> float:
    """Return the highest limit with `PEAKS_AN_HOUR` peaks over it and at least `LEAST_PEAKS`.

    If no limit has so many, it is `LEAST_BASE`.

    Args:
        recordings: what the test said of each recording.
        hours: time of all of them, h.
    """
    fewest = max(PEAKS_AN_HOUR * hours, LEAST_PEAKS)
    highest = max((look.statistic for looks in recordings for look in looks), default=0.0)
    steps = int(max(highest - LEAST_BASE, 0.0) / _BASE_STEP)
    for base in (LEAST_BASE + _BASE_STEP * step for step in range(steps, 0, -1)):
        if sum(len(_peaks(looks, base)) for looks in recordings) >= fewest:
            return base
    return LEAST_BASE


def peaks_over(base: float, recordings: Sequence[Sequence[Look]], hours: dict[str, float]) -> Tail:
    """Return the tail of the statistic's peaks over a base.

    Args:
        base: the low limit.
        recordings: what the test said of each recording.
        hours: time in each regime, h.
    """
    peaks = [peak for looks in recordings for peak in _peaks(looks, base)]
    tested = {name: time for name, time in hours.items() if name != NEAR_STOP}
    return tail_of(peaks, base, sum(hours.values()), tested)


def _peaks(looks: Sequence[Look], base: float) -> list[Look]:
    """Return the greatest statistic of each peak over a base, and the regime in which it began.

    An alarm comes when a limit is crossed, in the regime of that moment. A peak lasts for a minute
    at most. What goes on for longer counts anew: it would raise another alarm.
    """
    peaks: list[Look] = []
    peak: Look | None = None
    since = 0
    for look in looks:
        over = look.statistic > base
        if over:
            peak = look if peak is None else Look(max(peak.statistic, look.statistic), peak.regime)
            since += _EVERY
        if peak is not None and (not over or since >= _LONGEST):
            peaks.append(peak)
            peak, since = None, 0
    return peaks if peak is None else [*peaks, peak]


def hours_by_regime(recordings: Sequence[Blocks], parameters: Parameters) -> dict[str, float]:
    """Return the time in each regime that occurred, h, near stops included."""
    hours: dict[str, float] = {}
    for blocks in recordings:
        for block in blocks:
            name = regime_of(block, parameters)
            hours[name] = hours.get(name, 0.0) + (block.end_s - block.start_s) / 3600.0
    return hours
