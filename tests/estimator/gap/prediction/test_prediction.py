"""Predictions with frozen gains, and twins."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.gap.plant.interface import Plant, Trace
from estimator.gap.plant.records import Gains, Record, made_of, smoothed
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.servo.proposals import propose_position_delay
from tests.estimator.gap.courses import fitter, recorded, rig


@pytest.fixture(scope="module")
def plant() -> Plant:
    return rig()


@pytest.fixture(scope="module")
def record(plant: Plant) -> Record:
    return recorded(plant, plant.nominal)


@pytest.fixture(scope="module")
def gains(plant: Plant, record: Record) -> Gains:
    return Predictor(plant).filter(record, plant.nominal)


def test_a_rig_that_is_the_model_leaves_nearly_white_innovations_of_their_stated_size(
    plant: Plant, record: Record, gains: Gains
) -> None:
    innovations = Predictor(plant).innovations(record, gains, plant.nominal)[0][1000:]
    pressures = innovations[:, 1:3]
    assert np.std(pressures, axis=0) == pytest.approx([1.0, 1.0], abs=0.08)
    neighbours = np.mean(pressures[1:] * pressures[:-1], axis=0)
    assert neighbours == pytest.approx([0.0, 0.0], abs=0.15)


def test_going_back_to_values_brings_back_their_gains_without_a_run(
    plant: Plant, record: Record, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = {**plant.nominal, "viscous": 1.2 * plant.nominal["viscous"]}
    with fitter(plant, record) as of_record:
        first = of_record.filtered(plant.nominal)
        costs = first.costs(plant.nominal)
        assert not np.array_equal(of_record.filtered(other).costs(plant.nominal), costs)
        monkeypatch.delattr(Predictor, "filter")
        assert of_record.filtered(plant.nominal).gains[0] is first.gains[0]


def test_what_records_predict_does_not_depend_on_what_else_they_were_filtered_with(
    plant: Plant, record: Record
) -> None:
    other = {**plant.nominal, "viscous": 1.2 * plant.nominal["viscous"]}
    with fitter(plant, record) as of_record:
        alone = of_record.filtered(plant.nominal).costs(other)
        first, second = (of_record.filtered(values) for values in (plant.nominal, other))
        second.costs(other)
        assert np.array_equal(first.costs(other), alone)
        assert first.at(plant.nominal) is first
        assert first.at(other).gains[0] is second.gains[0]


def test_the_state_that_is_found_is_that_of_the_rig(
    plant: Plant, record: Record, gains: Gains
) -> None:
    states = Predictor(plant).innovations(record, gains, plant.nominal)[1]
    # The spool of a fast valve follows the command; the ram is where the encoder says.
    assert np.abs(states[1000:, 4] - record.readings[1000:, 0]).max() < 3e-5
    assert np.abs(states[1000:, 0] - record.readings[1000:, 3]).std() < 1.2e-6


@pytest.mark.parametrize("delay", [1e-3, 5e-3, 12e-3, 20e-3])
def test_a_late_position_is_predicted_nearly_as_well_as_one_in_time(
    plant: Plant, delay: float
) -> None:
    """No delay makes the filter swing up, and what it sees at once it predicts as without."""
    values = {**plant.nominal, "position_delay": delay}
    late = recorded(plant, values)
    predictor = Predictor(plant)
    gains = predictor.filter(late, values)
    innovations = predictor.innovations(late, gains, values)[0][1000:]
    assert np.std(innovations[:, 1:3], axis=0) == pytest.approx([1.0, 1.0], abs=0.1)
    assert np.std(innovations[:, 0]) < 1.3
    # Without what the delay makes of the reading nothing of this holds.
    assert np.std(predictor.innovations(late, gains, plant.nominal)[0][1000:, 0]) > 2.0


@pytest.mark.parametrize("delay", [0.0, 1.4e-3, 7.7e-3, 16e-3])
def test_the_delay_of_a_position_is_read_from_what_the_oil_makes_the_ram_do(
    plant: Plant, delay: float
) -> None:
    late = recorded(plant, {**plant.nominal, "position_delay": delay})
    trace = Trace(late.inputs, np.zeros((len(late), 11)), np.zeros((len(late), 4)), late.readings)
    (start,) = propose_position_delay([trace], plant.nominal)
    assert start["value"] == pytest.approx(delay, abs=5e-4)


def test_a_pressure_behind_its_lag_is_predicted_as_well_as_one_without(plant: Plant) -> None:
    values = {**plant.nominal, "pressure_lag": 0.02}
    slow = recorded(plant, values)
    predictor = Predictor(plant)
    gains = predictor.filter(slow, values)
    innovations = predictor.innovations(slow, gains, values)[0][1000:]
    assert np.std(innovations[:, 1:3], axis=0) == pytest.approx([1.0, 1.0], abs=0.1)


def test_a_twin_has_the_noise_floor_of_a_rig_that_is_the_model(
    plant: Plant, record: Record, gains: Gains
) -> None:
    predictor = Predictor(plant)
    twin = predictor.twin(record, plant.nominal, 5)
    of_twin = predictor.innovations(twin, predictor.filter(twin, plant.nominal), plant.nominal)[0][
        1000:
    ]
    of_rig = predictor.innovations(record, gains, plant.nominal)[0][1000:]
    assert np.abs(twin.readings[:, 0] - record.readings[:, 0]).max() < 1e-3
    assert not np.array_equal(twin.readings, record.readings)
    assert np.mean(of_twin**2) == pytest.approx(np.mean(of_rig**2), rel=0.03)


def test_noise_cut_off_at_a_sensors_limit_is_not_taken_for_a_reading(plant: Plant) -> None:
    rng = np.random.default_rng(0)
    empty = np.maximum(3e4 * rng.standard_normal(500), 0.0)
    readings = np.column_stack([np.full(500, 0.3), np.full(500, 6e6), empty, np.zeros(500)])
    record = made_of("empty chamber", np.zeros((500, 1)), readings, plant)
    assert np.isinf(record.variances[:, 2]).all()
    assert np.isfinite(record.variances[:, 1]).all()


def test_a_blow_against_a_stop_weighs_little(plant: Plant) -> None:
    high = plant.nominal["stroke_max"]
    readings = np.column_stack(
        [
            np.minimum(high - 0.1 + 0.2e-3 * np.arange(1000), high),
            np.where(np.arange(1000) < 500, 8e6, 9e6),
            np.where(np.arange(1000) < 500, 6e6, 2e6),
            np.full(1000, 1e-5),
        ]
    )
    record = made_of("stop", np.zeros((1000, 1)), readings, plant)
    wary = Predictor(plant).filter(record, plant.nominal).variances
    trusting = Predictor(replace(plant, violent=None)).filter(record, plant.nominal).variances
    assert wary[500, 2] > 100.0 * trusting[500, 2]
    assert wary[300, 2] == pytest.approx(trusting[300, 2])


def test_a_moving_mean_leaves_a_constant_and_centres_a_step() -> None:
    assert smoothed(np.full(40, 3.0)) == pytest.approx(np.full(40, 3.0))
    step = smoothed(np.r_[np.zeros(20), np.ones(20)])
    assert 0.0 < step[18] < step[20] < step[22] < 1.0
