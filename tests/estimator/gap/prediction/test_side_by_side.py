"""Runs in lanes come to what runs alone come to."""

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from estimator.gap.plant.interface import Plant
from estimator.gap.plant.records import Record
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.linear import Column
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.variables import nuisance_variable, started
from tests.estimator.gap.courses import recorded, rig


@pytest.fixture(scope="module")
def plant() -> Plant:
    return rig()


@pytest.fixture(scope="module")
def record(plant: Plant) -> Record:
    return recorded(plant, plant.nominal, seconds=3.0)


def tried(plant: Plant, base: Mapping[str, float]) -> list[dict[str, float]]:
    """Return values with each effect that has a start, and some of each nuisance."""
    found = [
        started(plant, base, effect, start)
        for effect in plant.effects.values()
        for start in effect.starts
    ]
    for nuisance in plant.nuisances:
        at = base[nuisance.parameter]
        found.append({**base, nuisance.parameter: at + nuisance.probe})
    return found


@pytest.mark.parametrize(
    "changed",
    [
        {},
        {"command_delay": 3.4e-3},
        {"valve_hysteresis": 4e-6, "pressure_lag": 2e-3},
        {"valve_deadband": 5e-6, "entrained_air": 0.01},
        {"position_delay": 6e-4, "position_backlash": 1e-4},
        {"supply_ripple": 2e5},
    ],
    ids=["nominal", "late", "play and lag", "laps and air", "late encoder", "alone"],
)
def test_innovations_of_many_parameters_are_those_of_each(
    plant: Plant, record: Record, changed: Mapping[str, float]
) -> None:
    predictor = Predictor(plant)
    base = {**plant.nominal, **changed}
    values = tried(plant, base)
    gains = predictor.filter(record, base)
    groups = predictor.groups(values)
    assert sorted(index for group in groups for index in group) == list(range(len(values)))
    for group in groups:
        together = predictor.innovations_of(record, gains, [values[index] for index in group])
        for index, found in zip(group, together, strict=True):
            wanted = predictor.innovations(record, gains, values[index])[0]
            assert np.abs(found - wanted).max() < 1e-6


def test_what_is_compared_side_by_side_is_rounded_alike(plant: Plant, record: Record) -> None:
    """A probe may be so small that lanes differ by more from a run alone than by it."""
    with ThreadPoolExecutor(2) as pool:
        filtered = Fitter(Predictor(plant), [record], pool).filtered(plant.nominal)
        same = [Column(f"none {number}", dict(plant.nominal), 1e-9) for number in range(9)]
        changes = filtered.changes(plant.nominal, same)
    assert all(not change.any() for of_column in changes for change in of_column)


def test_what_a_column_changes_is_the_same_whatever_was_asked_before(
    plant: Plant, record: Record
) -> None:
    values = tried(plant, plant.nominal)
    columns = [Column(f"{number}", each, 1.0) for number, each in enumerate(values)]
    with ThreadPoolExecutor(2) as pool:
        fitter = Fitter(Predictor(plant), [record], pool)
        wanted = fitter.filtered(plant.nominal).changes(plant.nominal, columns)
        asked = fitter.filtered(plant.nominal)
        for some in ([columns[3]], columns[2:4], columns[1:9:3]):
            asked.changes(plant.nominal, some)
        found = asked.changes(plant.nominal, columns)
    assert all(np.array_equal(a[0], b[0]) for a, b in zip(wanted, found, strict=True))


def test_a_fit_in_lanes_ends_where_one_of_runs_alone_does(plant: Plant, record: Record) -> None:
    variables = [nuisance_variable(each) for each in plant.nuisances]
    start = {**plant.nominal, "viscous": 380.0, "supply_pressure": 13.9e6}
    ends = []
    with ThreadPoolExecutor(2) as pool:
        for each in (plant, replace(plant, in_lanes=None)):
            ends.append(
                Fitter(Predictor(each), [record], pool).filtered(start).fit(start, variables)
            )
    first, second = ends
    assert first.cost == pytest.approx(second.cost, rel=1e-6)
    assert first.before == pytest.approx(second.before, rel=1e-6)
    assert first.cost < first.before
    for variable in variables:
        name = variable.parameter
        assert first.values[name] == pytest.approx(second.values[name], rel=1e-5)


def test_a_plant_that_runs_alone_is_run_alone(plant: Plant, record: Record) -> None:
    predictor = Predictor(replace(plant, in_lanes=None))
    values = tried(plant, plant.nominal)[:4]
    assert predictor.groups(values) == [[0], [1], [2], [3]]
    gains = predictor.filter(record, plant.nominal)
    found = predictor.innovations_of(record, gains, values)
    assert all(
        np.array_equal(each, predictor.innovations(record, gains, of)[0])
        for each, of in zip(found, values, strict=True)
    )


@pytest.mark.parametrize(
    "changed",
    [{}, {"command_delay": 3.4e-3}, {"valve_hysteresis": 4e-6}, {"position_backlash": 2e-4}],
    ids=["nominal", "late", "play", "play of the encoder"],
)
def test_gains_of_a_filter_whose_slopes_are_lanes_are_those_of_one_by_one(
    plant: Plant, record: Record, changed: Mapping[str, float]
) -> None:
    values = {**plant.nominal, **changed}
    alone = Predictor(replace(plant, in_lanes=None)).filter(record, values)
    beside = Predictor(plant).filter(record, values)
    for wanted, found in (
        (alone.variances, beside.variances),
        (alone.states, beside.states),
        (alone.couplings, beside.couplings),
    ):
        assert np.array_equal(np.isfinite(wanted), np.isfinite(found))
        known = np.isfinite(wanted)
        assert np.abs(found - wanted)[known].max() < 1e-4 * np.abs(wanted[known]).max()
