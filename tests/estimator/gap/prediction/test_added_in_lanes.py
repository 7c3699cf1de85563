"""What a model adds acts in lanes as it does in a run alone."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest

from estimator.gap.plant import Addition
from estimator.gap.plant.interface import Plant
from estimator.gap.plant.records import Record
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.sensitivities import course_of
from tests.estimator.gap.courses import recorded, rig

WAVE = Addition("reading of position_m", "position", "", "wave", (0.03, 0.2), (1e-4,))
DRIFT = Addition("bulk modulus", "time", "", "x", (), (1e8,))
TIGHT = Addition("friction level", "position", "", "bump", (0.3, 0.02), (300.0,))
CURVE = Addition("spool", "command", "", "table", (-0.1, 0.0, 0.1), (2e-6, 0.0, 3e-6))
SWING = Addition("flow, chamber 1", "velocity", "", "resonance", (30.0, 0.1), (1e-5, 1e-5))
STICKS = Addition("reading of pressure_2_Pa", "pressure 2", "", "play", (2e5,), (0.9,))
TURNED = Addition("reading of pressure_1_Pa", "velocity", "direction", "x", (), (1e5,))

MODELS = pytest.mark.parametrize(
    "additions",
    [[WAVE], [DRIFT, TIGHT], [CURVE], [SWING, STICKS, TURNED]],
    ids=["a reading", "parameters", "an equation", "memories and readings"],
)


@pytest.fixture(scope="module")
def plant() -> Plant:
    return rig(["pressure_1_bias"])


@pytest.fixture(scope="module")
def record(plant: Plant) -> Record:
    return recorded(plant, plant.nominal, seconds=1.5)


def alone(plant: Plant) -> Predictor:
    return Predictor(replace(plant, in_lanes=None))


def with_added(plant: Plant, additions: Sequence[Addition]) -> dict[str, float]:
    assert plant.layout is not None
    return {**plant.nominal, **plant.layout.values(additions)}


def near(values: Mapping[str, float]) -> list[dict[str, float]]:
    """Return values with a softer oil, and with a larger disturbance."""
    softer = {**values, "bulk_modulus": 0.98 * values["bulk_modulus"]}
    return [softer, {**values, "added_1_y0": 1.1 * values["added_1_y0"] + 1e-12}]


@MODELS
def test_innovations_with_additions_are_those_of_a_run_alone(
    plant: Plant, record: Record, additions: Sequence[Addition]
) -> None:
    values = with_added(plant, additions)
    predictor, tried = Predictor(plant), near(values)
    assert predictor.groups(tried) == [[0, 1]]
    gains = predictor.filter(record, values)
    together = predictor.innovations_of(record, gains, tried)
    for found, of in zip(together, tried, strict=True):
        assert np.abs(found - alone(plant).innovations(record, gains, of)[0]).max() < 1e-6


@MODELS
def test_gains_with_additions_are_those_of_a_filter_alone(
    plant: Plant, record: Record, additions: Sequence[Addition]
) -> None:
    values = with_added(plant, additions)
    wanted, found = alone(plant).filter(record, values), Predictor(plant).filter(record, values)
    for one, other in ((wanted.variances, found.variances), (wanted.states, found.states)):
        assert np.abs(one - other).max() < 1e-6 * np.abs(one).max()


@MODELS
def test_a_course_with_additions_is_linearised_as_alone(
    plant: Plant, record: Record, additions: Sequence[Addition]
) -> None:
    values = with_added(plant, additions)
    gains, samples = Predictor(plant).filter(record, values), np.arange(500, 1400)
    one, other = (
        course_of(each, record, gains, values, near(values), samples)
        for each in (alone(plant), Predictor(plant))
    )
    for wanted, found in (
        (one.transitions, other.transitions),
        (one.slopes, other.slopes),
        (one.shifts, other.shifts),
    ):
        assert np.abs(wanted - found).max() < 1e-9 * np.abs(wanted).max()


def test_models_whose_additions_enter_other_places_run_apart(plant: Plant) -> None:
    values = [with_added(plant, [each]) for each in (WAVE, CURVE, WAVE)]
    assert Predictor(plant).groups(values) == [[0, 2], [1]]


def test_a_droop_lets_the_filter_correct_the_pressure_of_the_supply(
    plant: Plant, record: Record
) -> None:
    """Without a droop or a back pressure nothing moves the pressures of pump and tank."""
    predictor = Predictor(plant)
    still = predictor.filter(record, plant.nominal).states[:, :, 7]
    drooping = predictor.filter(record, {**plant.nominal, "supply_droop": 5e12}).states[:, :, 7]
    assert not still[10:].any()
    assert drooping[10:].any()
