from collections.abc import Callable

import numpy as np
import pytest

from control.setpoints import Pseudorandom, Sine
from faults.campaign import Campaign, CampaignTest, SpringLoad
from rig.runner.outcomes.thresholds import HealthyReferences

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]

FIRST = "first 15 s of the test"


def innovations(
    level: float, count: int = 20_000
) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return level * np.random.default_rng(0).standard_normal((count, 2))


@pytest.fixture
def references(make_campaign: MakeCampaign) -> HealthyReferences:
    return HealthyReferences(make_campaign(filter_name="thesis-6"))


def test_a_healthy_test_with_the_same_setpoint_and_load_says_what_is_normal(
    references: HealthyReferences, make_test: MakeTest, leaking: MakeTest
) -> None:
    references.add(make_test(), innovations(1e4))
    learning = references.learning(leaking())
    assert learning.source == "healthy tests: healthy"
    assert learning.baseline is not None
    np.testing.assert_allclose(learning.baseline.normal, 1e4 * np.sqrt(2.0 / np.pi), rtol=0.02)


@pytest.mark.parametrize(
    "changes",
    [{"setpoint": Sine(0.3, 0.1, 0.5, 0.1, "position")}, {"load": SpringLoad(2e4, 0.3)}],
)
def test_another_setpoint_or_load_says_nothing(
    references: HealthyReferences,
    make_test: MakeTest,
    leaking: MakeTest,
    changes: dict[str, object],
) -> None:
    references.add(make_test(), innovations(1e4))
    assert references.learning(leaking(**changes)).baseline is None
    assert references.learning(leaking(**changes)).source == FIRST


def test_another_draw_of_the_same_random_setpoint_is_alike(
    references: HealthyReferences, make_test: MakeTest, leaking: MakeTest
) -> None:
    drawn = [Pseudorandom(0.2, 0.4, 0.2, 4.0, seed) for seed in (1, 2)]
    references.add(make_test(setpoint=drawn[0]), innovations(1e4))
    assert references.learning(leaking(setpoint=drawn[1])).baseline is not None


def test_healthy_tests_do_not_learn_from_themselves(
    references: HealthyReferences, make_test: MakeTest
) -> None:
    references.add(make_test(), innovations(1e4))
    assert references.learning(make_test()).source == FIRST


@pytest.mark.parametrize("useless", [innovations(np.nan), innovations(1e4, count=3000)])
def test_what_diverged_or_was_too_short_is_not_learnt_from(
    references: HealthyReferences,
    make_test: MakeTest,
    leaking: MakeTest,
    useless: np.ndarray[tuple[int, int], np.dtype[np.float64]],
) -> None:
    references.add(make_test(), useless)
    assert references.learning(leaking()).baseline is None


def test_the_default_detector_has_nothing_to_learn(
    make_campaign: MakeCampaign, make_test: MakeTest, leaking: MakeTest
) -> None:
    references = HealthyReferences(make_campaign(leaking(), make_test()))
    references.add(make_test(), innovations(1e4))
    assert references.learning(leaking()).source == ""
    assert references.running_order == [0, 1]
