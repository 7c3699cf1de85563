"""The linearised course answers kicks, and tells backwards which kicks would change a sum."""

import numpy as np
from hypothesis import given, settings, strategies as st

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
