"""A valve whose spool does not follow its command quite is where the spool's readings say."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from estimator.accounts.flow import AccountBlock
from estimator.accounts.noise import DEAD_ZONE, spool_flow
from estimator.accounts.nuisances import UNINFORMED
from estimator.baselines.learning import learnt_noise, spool_correction_of
from estimator.leaks.learnt_test import LearntLeakTest
from estimator.learnt.noise import LearntNoise
from rig.plant import FAULTS, LITRE_PER_MINUTE, NOMINAL
from tests.estimator.learnt.made_up import moving_blocks, noise

PLAY = 3e-7
"""Standard deviation of where the play leaves the spool, m."""
READING = 4.5e-8
"""Standard deviation of the mean of 500 readings with 1 um each, m."""
INTERNAL = FAULTS.index("internal_leakage")


def with_play(blocks: Sequence[AccountBlock], seed: int, play: float = PLAY) -> list[AccountBlock]:
    """Return blocks of a spool that is off its estimate by an amount that lasts for some blocks."""
    rng = np.random.default_rng((seed, 17))
    made, off = [], 0.0
    for block in blocks:
        off = play * rng.standard_normal() if rng.random() < 0.5 else off
        read = replace(block, spool_departure=off + READING * rng.standard_normal())
        true = spool_flow(replace(block, spool_departure=off))
        made.append(replace(read, missing=block.missing + true))
    return made


def without_readings(blocks: Sequence[AccountBlock]) -> list[AccountBlock]:
    return [replace(block, spool_departure=float("nan")) for block in blocks]


def thirds(blocks: list[AccountBlock]) -> list[list[AccountBlock]]:
    return [blocks[:80], blocks[80:160], blocks[160:]]


def learnt_from(blocks: list[AccountBlock]) -> LearntNoise:
    found = learnt_noise(thirds(blocks), NOMINAL)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def healthy() -> list[AccountBlock]:
    return with_play(moving_blocks(240, 5, factor=0.2), 5)


@pytest.fixture(scope="module")
def learnt(healthy: list[AccountBlock]) -> LearntNoise:
    return learnt_from(healthy)


def test_play_is_seen_in_the_readings_and_leaves_no_noise(
    healthy: list[AccountBlock], learnt: LearntNoise
) -> None:
    assert learnt.spool_correction == pytest.approx(1.0, abs=0.15)
    unread = learnt_from(without_readings(healthy))
    assert unread.spool_correction == 0.0
    assert learnt.regimes["moving"].factor < 0.4 * unread.regimes["moving"].factor


def test_readings_that_are_off_by_their_own_noise_alone_correct_nothing() -> None:
    blocks = with_play(moving_blocks(240, 6, factor=0.2), 6, play=0.0)
    assert spool_correction_of(thirds(blocks), noise(), NOMINAL) < 0.2


def test_an_internal_leak_is_seen_through_the_play(
    healthy: list[AccountBlock], learnt: LearntNoise
) -> None:
    later = with_play(moving_blocks(100, 7, factor=0.2), 7)
    size = np.mean([block.sizes[INTERNAL] for block in later])
    leak = 0.02 * LITRE_PER_MINUTE / size
    leaking = [
        replace(block, missing=block.missing + (k >= 80) * leak * block.faults[:, INTERNAL])
        for k, block in enumerate(later)
    ]
    test = LearntLeakTest(10.0, UNINFORMED, learnt, NOMINAL)
    for block in leaking:
        test.add(block)
    assert [finding.fault for finding in test.search()] == [INTERNAL]
    unread = LearntLeakTest(10.0, UNINFORMED, learnt_from(without_readings(healthy)), NOMINAL)
    for block in without_readings(leaking):
        unread.add(block)
    assert not unread.search()


def test_without_the_readings_that_it_was_learnt_with_the_careful_default_takes_over(
    learnt: LearntNoise,
) -> None:
    later = with_play(moving_blocks(40, 8, factor=0.2), 8)
    test = LearntLeakTest(10.0, UNINFORMED, learnt, NOMINAL)
    for block in later:
        test.add(block)
    assert test.dead_zone[INTERNAL] < DEAD_ZONE[INTERNAL]
    test.add(without_readings(later)[-1])
    assert test.dead_zone[INTERNAL] == DEAD_ZONE[INTERNAL]
