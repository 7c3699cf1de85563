"""Disturbances are found where they are, and a model with the right correction predicts."""

from collections.abc import Sequence

import numpy as np
import pytest

from estimator.gap.plant.interface import Array, Plant
from estimator.gap.plant.records import Record
from estimator.gap.prediction.predictor import Predictor
from tools.peers import correcting
from tools.peers.correcting import corrected, halves
from tools.peers.course import Course, squared_errors
from tools.peers.discrepancy import (
    Learned,
    Learner,
    Samples,
    Target,
    samples_of,
    targets_of,
    trusting_less,
)
from tools.peers.gaussian import gaussian
from tools.peers.sparse import sparse

from .oscillating import hidden, plant as the_plant, records as recorded

DRAG = -0.15


@pytest.fixture(scope="module")
def plant() -> Plant:
    return the_plant()


@pytest.fixture(scope="module")
def records(plant: Plant) -> list[Record]:
    return recorded(plant, hidden("v |v|", DRAG))


def drag(states: Array) -> Array:
    return np.asarray(DRAG * states[:, 1] * np.abs(states[:, 1]))


def test_without_a_correction_predictions_are_those_of_the_product(
    plant: Plant, records: list[Record]
) -> None:
    course = Course(plant, records[0], plant.nominal)
    expected = Predictor(plant).ahead(records[0], plant.nominal, course.states)
    np.testing.assert_array_equal(course.predictions().errors, expected)


def test_the_smoother_finds_the_hidden_acceleration(plant: Plant, records: list[Record]) -> None:
    course = Course(trusting_less(plant, 16.0), records[0], plant.nominal)
    (target,) = targets_of(plant)
    samples = samples_of(target, course)
    assert target.quantities == ("velocity", "position", "time")
    true = DRAG * samples.quantities[:, 0] * np.abs(samples.quantities[:, 0])
    slope = (samples.values @ true) / (true @ true)
    assert slope == pytest.approx(1.0, abs=0.1)


def test_the_hidden_term_as_correction_leaves_the_noise(
    plant: Plant, records: list[Record]
) -> None:
    courses = [Course(plant, records[2], plant.nominal)]

    def kicks(states: Array, inputs: Array, time_s: Array) -> Array:
        added = np.zeros_like(states)
        added[:, 1] = drag(states) * plant.period
        return added

    healthy = Course(plant, recorded(plant, hidden("v |v|", 0.0))[2], plant.nominal)
    floor = squared_errors([healthy])[0]
    assert squared_errors(courses)[0] > 10.0 * floor
    assert squared_errors(courses, kicks)[0] < 1.3 * floor


def test_a_correction_that_breaks_the_model_down_is_infinitely_wrong(
    plant: Plant, records: list[Record]
) -> None:
    course = Course(plant, records[0], plant.nominal)
    assert squared_errors([course], lambda states, inputs, time: states * np.inf)[0] == np.inf


def test_what_predicts_worse_on_other_recordings_is_not_taken(
    plant: Plant, records: list[Record]
) -> None:
    def fit(samples: Sequence[Samples], target: Target, last: bool) -> tuple[Learned | None, str]:
        return lambda quantities: 100.0 * np.sign(quantities[:, 0]), "nonsense"

    found = corrected(plant, records[:2], records[2:], Learner("nonsense", fit))
    assert found.corrections == ()


def test_a_single_recording_is_divided(plant: Plant, records: list[Record]) -> None:
    first, second = halves(records[0])
    assert (first.first, second.first) == (0, 2000)
    np.testing.assert_array_equal(
        np.concatenate([first.readings, second.readings]), records[0].readings
    )


@pytest.mark.parametrize("method", ["sparse", "process"])
def test_a_peer_finds_the_drag_and_closes_the_gap(
    plant: Plant, records: list[Record], method: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pysindy" if method == "sparse" else "sklearn")
    monkeypatch.setattr(correcting, "FACTORS", (4.0,))
    monkeypatch.setattr("tools.peers.gaussian.TRIED", 100)
    monkeypatch.setattr("tools.peers.gaussian.FITTED", 200)
    learner = sparse() if method == "sparse" else gaussian()
    before = squared_errors([Course(plant, records[2], plant.nominal)])[0]
    found = corrected(plant, records[:2], records[2:], learner)
    (correction,) = found.corrections
    assert correction.equation == "force balance"
    assert "velocity" in correction.of
    assert found.after[0] < 0.3 * before
