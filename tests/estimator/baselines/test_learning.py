"""The noise of a rig is learnt from its accounts, and the test then allows for it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from estimator.accounts.flow import AccountBlock
from estimator.accounts.noise import dead_zones
from estimator.accounts.nuisances import UNINFORMED
from estimator.baselines.learning import (
    Look,
    base_of,
    belief_of,
    folds_of,
    learnt_noise,
    peaks_over,
)
from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.learnt_test import LearntLeakTest
from estimator.learnt.content import LEAST_BASE
from estimator.learnt.noise import LearntNoise
from estimator.learnt.tail import RegimePeaks, Tail
from rig.plant import LITRE_PER_MINUTE, NOMINAL
from tests.estimator.learnt.made_up import moving, moving_blocks, noise


def with_leak(blocks: Sequence[AccountBlock], flow: float, onset: int) -> list[AccountBlock]:
    """Return blocks with a leak of chamber 1 of some L/min from a block on."""
    size = np.mean([abs(block.faults[0, 0]) for block in blocks])
    coefficient = flow * LITRE_PER_MINUTE / size
    return [
        replace(block, missing=block.missing + (k >= onset) * coefficient * block.faults[:, 0])
        for k, block in enumerate(blocks)
    ]


@pytest.fixture(scope="module")
def recordings() -> list[list[AccountBlock]]:
    # The nuisances of made-up blocks are drawn by the seed: this is one recording in three parts.
    made = moving_blocks(360, 5, factor=0.4)
    return [made[:120], made[120:240], made[240:]]


@pytest.fixture(scope="module")
def learnt(recordings: list[list[AccountBlock]]) -> LearntNoise:
    found = learnt_noise(recordings, NOMINAL)
    assert found is not None
    return found


def judged(learnt: LearntNoise, blocks: Sequence[AccountBlock]) -> LearntLeakTest:
    test = LearntLeakTest(10.0, UNINFORMED, learnt, NOMINAL)
    for block in blocks:
        test.add(block)
    return test


def test_the_noise_of_the_accounts_is_found(learnt: LearntNoise) -> None:
    assert set(learnt.regimes) == {"moving"}
    assert learnt.regimes["moving"].factor == pytest.approx(0.4, rel=0.2)
    assert learnt.tail.hours == pytest.approx(180.0 / 3600.0)


def test_a_leak_is_found_with_it_that_the_careful_default_does_not_claim(
    learnt: LearntNoise,
) -> None:
    blocks = with_leak(moving_blocks(120, 6, factor=0.4), 0.01, 60)
    careful = LeakTest(10.0)
    for block in blocks:
        careful.add(block)
    assert not careful.search()
    found = judged(learnt, blocks).search()
    assert [finding.fault for finding in found] == [0]
    assert found[0].onset == pytest.approx(60, abs=3)


def test_healthy_accounts_stay_silent(learnt: LearntNoise) -> None:
    assert not judged(learnt, moving_blocks(120, 7, factor=0.4)).search()


def test_contact_with_a_stroke_end_is_not_tested(learnt: LearntNoise) -> None:
    blocks = moving_blocks(60, 8, factor=0.4)
    pressed = [moving(block, 0.0, 0.0) for block in with_leak(moving_blocks(60, 9), 2.0, 0)]
    test = judged(learnt, [*blocks, *pressed])
    assert test.blocks == 60
    assert not test.search()


def test_a_regime_that_was_not_learnt_is_judged_as_on_any_rig(learnt: LearntNoise) -> None:
    blocks = moving_blocks(40, 10)
    test = judged(learnt, blocks)
    sure = test.limit()
    assert test.dead_zone[0] < 0.5 * dead_zones(1.0)[0]
    test.add(moving(moving_blocks(41, 10)[-1], travel=0.2))
    assert test.limit() > sure
    assert np.array_equal(test.dead_zone, dead_zones(1.0))


def test_statistics_that_went_far_while_healthy_raise_the_limit() -> None:
    blocks = moving_blocks(40, 11)
    quiet, restless = (
        judged(noise(tail), blocks) for tail in (Tail(3.0, 1.0, 2, 0.5), Tail(3.0, 1.0, 40, 60.0))
    )
    assert restless.limit() > 1.5 * quiet.limit()
    assert restless.sharpness() < quiet.sharpness() <= 1.0


def test_a_limit_that_was_learnt_may_be_below_that_for_noise_but_the_end_of_a_leak_stays_sure() -> (
    None
):
    blocks = moving_blocks(40, 11)
    parts = (RegimePeaks("moving", 1.0, 20),)
    calm = judged(noise(Tail(0.8, 1.0, 20, 6.0, parts)), blocks)
    former = judged(noise(Tail(3.0, 1.0, 0, 0.0)), blocks)
    assert calm.limit() < 3.0 < former.limit()
    assert calm.change_limit() == pytest.approx(former.change_limit())
    assert calm.sharpness() * calm.limit() == pytest.approx(former.limit())


def test_peaks_are_counted_from_where_they_come_twenty_times_an_hour() -> None:
    rng = np.random.default_rng(2)
    heights = np.maximum(rng.exponential(0.4, 3600), 0.0)
    heights[1::2] = 0.0
    looks = [Look(float(height), "moving") for height in heights]
    base = base_of([looks], 1.0)
    tail = peaks_over(base, [looks], {"moving": 0.9, "near_stop": 0.1})
    assert 20 <= tail.peaks <= 30
    assert tail.excess / tail.peaks == pytest.approx(0.4, rel=0.4)
    assert tail.regimes == (RegimePeaks("moving", 0.9, tail.peaks),)
    assert base_of([[Look(0.4, "moving")] * 3600], 1.0) == LEAST_BASE


def test_a_peak_that_stays_counts_anew_every_minute() -> None:
    looks = [Look(2.0, "creep")] * 150 + [Look(0.0, "creep")] * 10
    assert peaks_over(1.0, [looks], {"creep": 0.05}).peaks == 3


def test_recordings_or_their_pieces_make_folds(recordings: list[list[AccountBlock]]) -> None:
    assert [len(fold) for fold in folds_of(recordings)] == [1, 1, 1]
    whole = [block for part in recordings for block in part]
    assert [len(fold[0]) for fold in folds_of([whole])] == [120, 120, 120]
    assert learnt_noise([whole[:60]], NOMINAL) is None


def test_more_recordings_make_the_nuisances_surer(
    recordings: list[list[AccountBlock]], learnt: LearntNoise
) -> None:
    one, all_three = (belief_of(each, learnt, NOMINAL) for each in (recordings[:1], recordings))
    assert np.trace(all_three.covariance) < np.trace(one.covariance)
