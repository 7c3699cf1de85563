"""What is told of a disturbance that was discovered."""

import numpy as np
import pytest

from estimator.gap.search.discovery import Discovery
from estimator.gap.search.disturbances import places_of
from estimator.gap.search.explaining import Explanation
from estimator.gap.search.shapes import Shape
from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.verdict.describing import described_as
from rig.plant import Model


@pytest.mark.parametrize(
    ("of", "form", "unit"),
    [
        ("", "constant", "N"),
        ("direction", "x", "N/(1)"),
        ("velocity", "x |x|", "N/(m/s)^2"),
        ("position", "hinge", "N/(m)"),
    ],
)
def test_a_size_has_the_unit_that_its_form_gives_it(of: str, form: str, unit: str) -> None:
    plant = servo_actuator(Model())
    place = next(each for each in places_of(plant) if each.name == "force balance")
    shape = Shape(of, "", form, (0.1,) if form == "hinge" else ())
    explanation = Explanation(place, shape, np.ones(1), np.ones(1), np.array([60.0, 40.0]), 0.5)
    found = Discovery(explanation, explanation.addition, (0.1,), (), 0.5, {}, {}, (-0.2, 0.2))
    size, *_ = described_as(found, plant).estimates
    assert (size.key, size.unit) == ("size", unit)
