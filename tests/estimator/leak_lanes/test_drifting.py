"""A drift of the encoder is scored in lanes as it is by the replay of the same blocks."""

import numpy as np

from estimator.encoder import DriftTest
from estimator.encoder.drift_test import KEPT
from estimator.leak_lanes.compiled_tests import CompiledDriftTest
from rig.plant import NOMINAL
from tests.estimator.encoder.test_drift_test import drifting, moving


def test_scores_and_findings_of_a_drift_are_those_of_a_replay() -> None:
    compiled, plain = CompiledDriftTest(NOMINAL, 1.0), DriftTest(NOMINAL, 1.0)
    named = 0
    # More blocks than are kept, so that the oldest ones count in sums only.
    for number, block in enumerate(drifting(moving(KEPT + 6, 3), 4e-3), 1):
        compiled.add(block)
        plain.add(block)
        if number % 20 and number < KEPT:
            continue
        here, there = compiled.search(), plain.search()
        assert (here is None) == (there is None)
        if here is not None and there is not None:
            assert here.could_also_be == there.could_also_be
            np.testing.assert_allclose(
                [here.rate_m_per_s, here.statistic, here.gain],
                [there.rate_m_per_s, there.statistic, there.gain], rtol=1e-6,
            )  # fmt: skip
            named += 1
        ours, theirs = compiled._scores(), plain._scores()
        for field in ("coefficient", "information", "explained", "variance"):
            np.testing.assert_allclose(
                getattr(ours[0], field), getattr(theirs[0], field), rtol=1e-5, atol=1e-9
            )
        np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-5, atol=1e-6)
    assert named >= 5
