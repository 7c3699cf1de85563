"""Quantities out of their limits are refused, with the slip that explains them."""

import pytest

from rig.configuration.reading.fields import Adjustable, Interval, Physical, Relative
from rig.configuration.reading.quantities import QuantityError


@pytest.mark.parametrize(
    ("physical", "text", "limit", "meant"),
    [
        (Physical("Pa", 1e6, 3.5e7, 13.8e6), "138 MPa", "is above 35 MPa", "13.8 MPa"),
        (Physical("Pa", 1e6, 3.5e7, 13.8e6), "2000 MPa", "is above 35 MPa", "2000 psi"),
        (Physical("Pa", 1e6, 3.5e7, 13.8e6), "13.8 Pa", "is below 1e+06 Pa", "13.8 MPa"),
        (Physical("m", -5e-5, 5e-5, 9.8e-6), "9.8 mm", "is above 0.05 mm", "9.8 um"),
        (Physical("", 0.0, 1.0, 0.3), "35", "is above 1", "0.35"),
    ],
)
def test_out_of_range_names_the_limit_in_the_unit_used_and_what_was_meant(
    physical: Physical, text: str, limit: str, meant: str
) -> None:
    with pytest.raises(QuantityError) as caught:
        physical.parse(text)
    assert caught.value.limit == limit
    assert caught.value.remedy == f"did you mean {meant}?"


def test_nothing_is_suggested_where_no_slip_would_fit() -> None:
    with pytest.raises(QuantityError) as caught:
        Physical("s", 0.0, 40.0).parse("-3 s")
    assert caught.value.remedy == "at least 0 s"


def test_a_signed_percentage_deviates_from_the_model_and_an_unsigned_one_is_refused() -> None:
    field = Adjustable(Physical("Pa", 5e7, 2.5e9))
    assert field.parse("-4 %") == Relative(-0.04)
    assert field.parse("689 MPa") == 689e6
    with pytest.raises(QuantityError, match="with its sign"):
        field.parse("4 %")


def test_an_interval_has_its_lower_end_first() -> None:
    field = Interval(Physical("m", 0.0, 1.0))
    assert field.parse(["5 mm", "0.6 m"]) == (0.005, 0.6)
    for raw in (["0.6 m", "5 mm"], ["0.1 m"], "0.1 m", {"from": 1}):
        with pytest.raises(QuantityError):
            field.parse(raw)
    assert Interval(Physical("s"), single=True).parse("2 s") == (2.0, 2.0)
