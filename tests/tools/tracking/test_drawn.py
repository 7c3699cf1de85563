"""The rigs on which tracking is judged are drawn alike, and judged by what they can do."""

import numpy as np
import pytest

from rig.configuration import load_rig
from rig.plant import Model
from tools.tracking.drawn import drawn_plant, is_reachable
from tools.tracking.runs import Run


def test_a_rig_follows_from_its_number_and_every_second_hides_an_effect() -> None:
    assert drawn_plant(4) == drawn_plant(4)
    assert drawn_plant(4)[0] != drawn_plant(6)[0]
    assert drawn_plant(4)[1] == ""
    assert all(drawn_plant(number)[1] for number in range(1, 20, 2))


def test_a_sine_against_a_stiff_spring_is_out_of_reach() -> None:
    rig = load_rig("simulated")
    assert is_reachable(rig, Model())
    stiff = Model().with_effect("spring_load", stiffness=6e4, contact=0.22)
    assert not is_reachable(rig, stiff)


def test_another_seed_draws_other_rigs() -> None:
    assert drawn_plant(4, 22) == drawn_plant(4, 22)
    assert drawn_plant(4, 22)[0] != drawn_plant(4)[0]


def test_a_ram_that_creeps_one_way_does_not_hunt() -> None:
    time_s = np.arange(100, dtype=np.float64)
    still = np.zeros(100)
    creeping = Run(time_s, still, still, np.linspace(0.0, 1e-3, 100), still)
    swinging = Run(time_s, still, still, 1e-3 * np.sin(time_s), still)
    assert creeping.hunting(0.0) == 0.0
    assert creeping.swing(50.0) == pytest.approx(0.5e-3, rel=0.02)
    assert swinging.hunting(0.0) == pytest.approx(2e-3, rel=0.02)
