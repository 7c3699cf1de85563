"""How the ram works during a block decides which noise is expected of it."""

import pytest

from estimator.learnt.regimes import REGIMES, regime_of
from rig.plant import NOMINAL
from tests.estimator.leaks.test_leak_statistic import blocks
from tests.estimator.learnt.made_up import moving


@pytest.mark.parametrize(
    ("travel", "start", "regime"),
    [
        (5e-5, 0.3, "standstill"),
        (2e-3, 0.3, "creep"),
        (2e-2, 0.3, "moving"),
        (8e-2, 0.3, "fast"),
        (2e-2, 0.001, "near_stop"),
        (2e-2, NOMINAL.stroke_max - 0.0215, "near_stop"),
    ],
)
def test_travel_and_place_tell_the_regime(travel: float, start: float, regime: str) -> None:
    assert regime_of(moving(blocks(1, 1)[0], travel, start), NOMINAL) == regime
    assert regime in REGIMES


def test_a_ram_that_pushes_with_a_third_of_the_supply_is_loaded() -> None:
    block = moving(blocks(1, 1)[0])
    block.sizes[2] = (0.4 * NOMINAL.supply_pressure) ** 0.5
    assert regime_of(block, NOMINAL) == "loaded"
