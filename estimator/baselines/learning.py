"""Learns the noise of one rig from its healthy accounts, each part judged by what the others say.

The accounts are divided into folds of whole recordings, or of pieces of them. Noise by regime comes
from what is left of every fold when the nuisances of the other folds are expected. The test itself
is then run over every fold, with the nuisances and the noise of the others, and its peaks over a
low limit say how often higher limits are exceeded (`estimator.learnt.tail`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from math import ceil
from typing import Final, TypeVar

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
from estimator.leaks import MINIMUM_BLOCKS, LearntLeakTest
from estimator.learnt import (
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
BASE: Final = 3.0
"""Limit over which peaks of the statistic are counted. It is high enough for the excesses to be
nearly exponential. Rigs of another maker had 4 to 20 peaks an hour over it, enough to tell how
steeply their number falls (`tools.alarm_rates`)."""
_EVERY: Final = 2
"""The statistic is looked at once in this many blocks; it changes little within a second."""
_LONGEST: Final = 120
"""Blocks (one minute) after which a peak ends and the test begins anew, as after an alarm."""
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
    peaks: list[float] = []
    hours = 0.0
    for fold, belief, noise in zip(folds, beliefs, noises, strict=True):
        for blocks in fold:
            peaks += peaks_of(blocks, belief, noise, parameters)
            hours += sum(block.end_s - block.start_s for block in blocks) / 3600.0
    every = [each for fold in left for each in fold]
    learnt = _bare(measured_noise(every))
    learnt = replace(learnt, dead_zone=dead_zone_of(every, learnt, parameters))
    correction = spool_correction_of(recordings, learnt, parameters)
    return replace(learnt, tail=tail_of(peaks, BASE, hours), spool_correction=correction)


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
    left: Sequence[Residuals], noise: LearntNoise, parameters: Parameters
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
    zones = default * np.sqrt([careful(variance, count) for variance in variances])
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
    return LearntNoise(regimes, tuple(map(float, dead_zones(0.0))), Tail(BASE, 1.0, 0, 0.0))


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


class _PeakTest(LearntLeakTest):
    """A test that claims whatever exceeds the limit for peaks, leaks that grow too."""

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        return BASE


def peaks_of(
    blocks: Blocks, expected: NuisanceBelief, noise: LearntNoise, parameters: Parameters
) -> list[float]:
    """Return the peaks of the test's statistic over `BASE` in one recording.

    A peak ends when no fault exceeds the limit, or after a minute; then the test begins anew.

    Args:
        blocks: the blocks of the recording.
        expected: the nuisances before any block.
        noise: what was learnt of the rig by other accounts.
        parameters: the parameters that were assumed.
    """

    def begun() -> _PeakTest:
        return _PeakTest(1.0, expected, noise, parameters)

    test, peaks = begun(), []
    peak, since = 0.0, 0
    for number, block in enumerate(blocks):
        test.add(block)
        if number % _EVERY or test.blocks < MINIMUM_BLOCKS:
            continue
        findings = test.search()
        if findings:
            peak = max(peak, *(finding.statistic for finding in findings))
            since += _EVERY
        if peak and (not findings or since >= _LONGEST):
            peaks.append(peak)
            if since >= _LONGEST:
                test = begun()
            peak, since = 0.0, 0
    return [*peaks, peak] if peak else peaks
