"""The linearised course answers kicks, and tells backwards which kicks would change a sum."""

import numpy as np
from hypothesis import given, settings, strategies as st

from estimator.gap.prediction.block_sums import BlockSums, weights_of
from estimator.gap.prediction.sensitivities import Course

STATES, OUTPUTS, LENGTH = 4, 3, 60


def course(rng: np.random.Generator) -> Course:
    """Return a course of arbitrary matrices, with missing readings and two stretches."""
    return Course(
        np.arange(LENGTH),
        rng.normal(size=(LENGTH, OUTPUTS)),
        rng.normal(size=(LENGTH, STATES)),
        rng.normal(size=(LENGTH, 1)),
        0.5 * rng.normal(size=(LENGTH, STATES, STATES)),
        rng.normal(size=(LENGTH, OUTPUTS, STATES)),
        0.2 * rng.normal(size=(LENGTH, OUTPUTS, STATES)),
        np.where(rng.random((LENGTH, OUTPUTS)) < 0.2, np.inf, 0.1 + rng.random((LENGTH, OUTPUTS))),
        (np.arange(LENGTH) % 35 == 0).astype(np.int64),
        np.zeros((LENGTH, STATES + OUTPUTS, 0)),
    )


@settings(deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_weighted_sum_of_answers_is_the_kicks_times_their_pulls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    along = course(rng)
    weights, kicks = rng.normal(size=(LENGTH, OUTPUTS)), rng.normal(size=(LENGTH, 3, 5))
    rows = [0, 2, STATES + 1]
    forwards = np.einsum("ti,tic->c", weights, along.answers(rows, kicks))
    backwards = np.einsum("tr,trc->c", along.pulls(weights)[:, rows], kicks)
    scale = np.abs(weights[:, :, None] * along.answers(rows, kicks)).sum((0, 1))
    assert np.all(np.abs(forwards - backwards) < 1e-9 * (1.0 + scale))


def test_block_sums_are_those_of_the_weighted_answers_to_each_kick() -> None:
    rng = np.random.default_rng(1)
    along = course(rng)
    known = rng.normal(size=(LENGTH, OUTPUTS, 2))
    rows, rates = [1, STATES], rng.normal(size=(LENGTH, 2)) * [1.0, 0.0]
    shapes = rng.normal(size=(LENGTH, 3))
    blocks = [slice(5, 25), slice(35, 55)]
    sums = BlockSums(along, known, blocks)
    (one, two) = sums.summed(rows, rates, shapes, [1, 2])
    root = np.sqrt(weights_of(along))[:, :, None]
    answers = along.answers(rows, rates[:, :, None] * shapes[:, None, :])
    changes = np.concatenate([known * root, answers * root], axis=2)
    left = along.innovations * root[:, :, 0]
    for b, block in enumerate(blocks):
        every = changes[block].reshape(-1, 5)
        for (products, slopes), columns in ((one, [0, 1, 2]), (two, [0, 1, 3, 4])):
            own = every[:, columns]
            np.testing.assert_allclose(products[b], own.T @ own, atol=1e-9)
            np.testing.assert_allclose(slopes[b], left[block].ravel() @ own, atol=1e-9)
        np.testing.assert_allclose(sums.squares[b], np.square(left[block]).sum())
    assert sums.used == sum(np.isfinite(along.variances[block]).sum() for block in blocks)
