"""What remembers the motion is discovered with its frequency, its damping or its time constant."""

import pytest

from estimator.gap.prediction.results import GapResult
from estimator.gap.verdict.phases import as_written
from estimator.gap.verdict.workflow import find_gap
from tests.estimator.gap.wheel import ran, wheel


def _lacks(**hidden: tuple[float, ...]) -> GapResult:
    recordings = [ran(seed, 8.0, **hidden) for seed in (1, 2)]  # type: ignore[arg-type]
    return find_gap(recordings, [ran(3, 8.0, **hidden)], wheel())  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def swinging() -> GapResult:
    return _lacks(hung=(0.5, 9.0, 0.08))


def test_a_second_mass_on_a_spring_is_a_resonance_of_the_force(swinging: GapResult) -> None:
    assert swinging.verdict == "unknown_effect"
    first = swinging.discovered[0]
    assert (first.name, first.place, first.of) == ("resonance", "force", "speed")
    found = {each.key: each.value for each in first.estimates}
    assert found["frequency"] == pytest.approx(9.0, rel=0.02)
    assert found["damping"] == pytest.approx(0.08, rel=0.25)
    assert "a mass on a spring" in first.parts
    assert swinging.gap_after < 0.05 * swinging.gap_before


def test_the_model_written_does_not_have_it_as_a_simulation_has_no_memory_for_it(
    swinging: GapResult,
) -> None:
    assert not swinging.discovered[0].in_model
    assert as_written(wheel().layout, swinging.values)[1] == []
    assert any("no memory for it" in reason for reason in swinging.reasons)


@pytest.mark.long
def test_a_damper_that_gives_way_in_time_is_a_lag_of_the_force() -> None:
    found = _lacks(creep=(6.0, 0.05))
    first = found.discovered[0]
    assert (first.name, first.place, first.of) == ("lag", "force", "speed")
    _, constant = first.estimates
    assert constant.value == pytest.approx(0.05, rel=0.1)
    assert found.gap_after < 0.05 * found.gap_before
