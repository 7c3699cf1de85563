"""What is left because the rig was not the same in the recordings held out is told as such."""

from concurrent.futures import ThreadPoolExecutor

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.held_out import channel_gaps, mean_gap
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.verdict.another_day import changed_since
from tests.estimator.gap.wheel import ran, wheel


def told(**held_out: float) -> list[str]:
    """Return what is told of a model that is right in all but what the wheel held out is."""
    plant = wheel()
    predictor, records = Predictor(plant), [record_of(ran(5, 6.0, **held_out), plant)]  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as pool:
        left = mean_gap(channel_gaps(predictor, records, plant.nominal, plant.nominal, pool))[1]
        return changed_since(Fitter(predictor, records, pool), plant.nominal, (10.0 * left, left))


def test_a_drag_that_changed_since_is_told_by_how_much() -> None:
    (said,) = told(drag=9.2)
    assert "drag 15.3% more" in said
    assert "the machine was not quite the same there" in said


def test_of_a_rig_that_is_the_same_nothing_is_told() -> None:
    assert told() == []


def test_of_what_no_nuisance_takes_away_nothing_is_told() -> None:
    assert told(offset=1.0, late=2) == []
