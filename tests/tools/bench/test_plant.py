"""The contestants of the plant benchmark integrate the same motion equally well."""

import numpy as np
import pytest

from rig.plant.dynamics import PlantState
from tools.bench.plant import accuracies, courses, lsoda, measure, right_hand_side


def test_lsoda_is_given_the_tolerance_at_which_it_is_as_accurate_as_ours() -> None:
    _, sliding, _ = courses(1500)
    ours, theirs, tolerance = accuracies(right_hand_side(), sliding)
    assert theirs <= ours < 3e3
    assert tolerance < 1e-3


def test_lsoda_follows_the_same_motion() -> None:
    _, sliding, _ = courses(600)
    found = lsoda(right_hand_side(), sliding.along[560], sliding.command[560:580], 1e-9)
    position = PlantState._fields.index("position")
    assert found[-1, position] == pytest.approx(sliding.along[579, position], abs=1e-6)


def test_the_table_has_a_line_for_each_motion() -> None:
    motions = courses(700)
    assert measure(motions, rounds=1).row_count == len(motions)
    assert np.isfinite([motion.along for motion in motions]).all()
