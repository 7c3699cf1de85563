"""A tone has one frequency in all recordings, and a phase of its own in each of them."""

import numpy as np
import pytest

from estimator.gap.plant.records import Record
from estimator.gap.prediction.linear import slices_of
from estimator.gap.prediction.results import GapResult
from estimator.gap.verdict.phases import beginning, has_tones
from estimator.gap.verdict.workflow import find_gap
from tests.estimator.gap.wheel import ran, wheel

HUM_N, HUM_HZ = 1.5, 17.3


@pytest.fixture(scope="module")
def found() -> GapResult:
    recordings = [ran(seed, 12.0, hum=HUM_N, hum_hz=HUM_HZ) for seed in (1, 2)]
    return find_gap(recordings, [ran(3, 12.0, hum=HUM_N, hum_hz=HUM_HZ)], wheel())


def test_a_hum_is_discovered_with_its_frequency_and_its_size(found: GapResult) -> None:
    assert found.verdict == "unknown_effect"
    (hum,) = found.discovered
    assert (hum.name, hum.place, hum.of) == ("tone", "force", "time")
    size, period = hum.estimates
    assert size.lower < HUM_N < size.upper
    assert 1.0 / period.value == pytest.approx(HUM_HZ, abs=0.02)
    assert "17.3 times a second" in hum.text
    assert "begins each recording at another phase" in hum.text


def test_its_phase_in_a_recording_held_out_is_that_of_the_first_two_seconds(
    found: GapResult,
) -> None:
    assert found.gap_before > 10.0
    assert found.gap_after < 0.05 * found.gap_before


def test_the_model_written_does_not_have_it_as_the_next_recording_begins_at_another_phase(
    found: GapResult,
) -> None:
    layout = wheel().layout
    assert layout is not None
    assert not found.discovered[0].in_model
    assert not has_tones(layout, found.values)


@pytest.mark.parametrize(("period", "lasts_s"), [(1e-3, 2.0), (0.02, 2.0), (0.1, 8.0), (1.0, 80.0)])
def test_a_phase_is_taken_from_three_blocks_whatever_the_period(
    period: float, lasts_s: float
) -> None:
    count = beginning(period)
    assert count * period == pytest.approx(lasts_s)
    empty = np.zeros((count, 1))
    assert len(slices_of(Record("", empty, empty, empty), period)) == 3


@pytest.mark.long
def test_no_tone_is_claimed_where_there_is_none() -> None:
    found = find_gap([ran(4, 8.0, squared=0.5)], [ran(6, 6.0, squared=0.5)], wheel())
    assert "tone" not in [each.name for each in found.discovered]
    assert np.isfinite(found.gap_after)
