"""The sizes that are said to show are those from which an effect would be named."""

import pytest

from estimator.gap.signatures import limits
from estimator.gap.variables import nuisance_variable
from tests.estimator.gap.courses import fitter, recorded, rig


@pytest.mark.parametrize("softer", [0.0, 0.1])
def test_what_a_refit_may_take_does_not_show(softer: float) -> None:
    plant = rig(["bulk_modulus", "viscous_friction", "supply_pressure", "pressure_1_bias"])
    values = {**plant.nominal, "bulk_modulus": (1.0 - softer) * plant.nominal["bulk_modulus"]}
    with fitter(plant, recorded(plant, values)) as fitted:
        fitted.refresh(values)
        shown = limits(fitted, values, [nuisance_variable(n) for n in plant.nuisances])
    sizes = {limit.effect: limit.size for limit in shown}
    for nuisance in plant.nuisances:
        if nuisance.effect is not None:
            # About the nominal value; from the value written it may be farther.
            away = abs(values[nuisance.parameter] - nuisance.nominal)
            width = nuisance.tolerance * nuisance.nominal
            assert away + width < sizes[nuisance.effect] < 2.0 * (away + width)
    assert 0.0 < sizes["pressure_1_bias"] < 1e5
