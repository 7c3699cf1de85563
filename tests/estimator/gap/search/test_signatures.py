"""The sizes that are said to show are those from which an effect would be named."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.gap.plant.records import made_of
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.variables import nuisance_variable
from estimator.gap.search.signatures import cosines, limits
from tests.estimator.gap.courses import fitter, recorded, rig


@pytest.mark.parametrize("softer", [0.0, 0.1])
def test_what_a_refit_may_take_does_not_show(softer: float) -> None:
    plant = rig(["bulk_modulus", "viscous_friction", "supply_pressure", "pressure_1_bias"])
    values = {**plant.nominal, "bulk_modulus": (1.0 - softer) * plant.nominal["bulk_modulus"]}
    with fitter(plant, recorded(plant, values)) as of_record:
        shown = limits(
            of_record.filtered(values), values, [nuisance_variable(n) for n in plant.nuisances]
        )
    sizes = {limit.effect: limit.size for limit in shown}
    for nuisance in plant.nuisances:
        if nuisance.effect is not None:
            # About the nominal value; from the value written it may be farther.
            away = abs(values[nuisance.parameter] - nuisance.nominal)
            width = nuisance.tolerance * nuisance.nominal
            assert away + width < sizes[nuisance.effect] < 2.0 * (away + width)
    assert 0.0 < sizes["pressure_1_bias"] < 1e5


def test_a_valves_greatest_speed_shows_if_the_motion_needs_more() -> None:
    plant = rig(["valve_rate_limit"])
    time = np.arange(4000) * plant.period
    steps = 1.5 * np.sign(np.sin(12.0 * time + 0.3))[:, None]
    readings = np.tile([0.3, 6.9e6, 6.9e6, 0.0], (len(time), 1))
    asked = made_of("steps", steps, readings, plant)
    record = Predictor(replace(plant, steering=())).twin(asked, plant.nominal, 0)
    speed = np.abs(np.gradient(record.readings[:, 3], plant.period))
    with fitter(plant, record) as of_record:
        filtered = of_record.filtered(plant.nominal)
        nuisances = [nuisance_variable(n) for n in plant.nuisances]
        (shown,) = limits(filtered, plant.nominal, nuisances)
        known = {**plant.nominal, "valve_rate_limit": shown.size}
        assert limits(filtered, known, nuisances) == []
    assert (shown.effect, shown.key, shown.unit) == ("valve_rate_limit", "value", "m/s")
    assert 0.3 * speed.max() < shown.size < speed.max()


def test_slow_motions_show_no_greatest_speed_of_a_valve() -> None:
    plant = rig(["valve_rate_limit"])
    with fitter(plant, recorded(plant, plant.nominal)) as of_record:
        filtered = of_record.filtered(plant.nominal)
        (shown,) = limits(filtered, plant.nominal, [nuisance_variable(n) for n in plant.nuisances])
    assert shown.size == 0.0


def test_a_model_that_breaks_down_without_an_effect_has_no_cosines() -> None:
    plant = rig(["pressure_1_bias"])
    with fitter(plant, recorded(plant, plant.nominal, seconds=2.0)) as of_record:
        filtered = of_record.filtered(plant.nominal)
        broken = {**plant.nominal, "piston_area": float("nan")}
        assert np.isnan(cosines(filtered, broken, [], {"one": plant.nominal, "two": broken})).all()
