"""Quantities are read as written, to the last bit, and misread ones say what was meant."""

import contextlib
from math import isfinite

import pytest
from hypothesis import given, strategies as st

from rig.configuration.reading.quantities import (
    DIMENSIONS,
    QuantityError,
    WrongDimensionError,
    read,
    show,
    unit_factor,
)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("13.8 MPa", "Pa", 13.8e6),
        ("0.03 mm", "m", 3e-5),
        ("9.8 um", "m", 9.8e-6),
        ("9.8 µm", "m", 9.8e-6),
        ("0.5 L/min", "m^3/s", 0.5 / 6e4),
        ("2e4 N/m", "N/m", 2e4),
        ("4e-9 m^3/(s Pa^0.5)", "m^3/(s Pa^0.5)", 4e-9),
        ("4e-9 m^3/(s sqrt(Pa))", "m^3/(s Pa^0.5)", 4e-9),
        ("4e-9 m^3/(s*sqrt(Pa))", "m^3/(s Pa^0.5)", 4e-9),
        ("8e11 Pa/(m^3/s)^2", "Pa/(m^3/s)^2", 8e11),
        ("35 %", "", 0.35),
        ("0.35", "", 0.35),
        (0.35, "", 0.35),
        (7, "", 7.0),
        ("-3 V", "V", -3.0),
        ("180 deg", "rad", 3.141592653589793),
        ("138 bar", "Pa", 1.38e7),
        ("2000 psi", "Pa", 13789514.586336723),
        ("1 gpm", "m^3/s", 6.30901964e-05),
        ("12 in", "m", 0.3048),
        ("5 in/s", "m/s", 0.127),
        ("1 gpm/psi^0.5", "m^3/(s Pa^0.5)", 7.598055e-07),
    ],
)
def test_a_quantity_is_the_nearest_float_to_what_is_written(
    text: object, unit: str, value: float
) -> None:
    digits = 1e-6 if "gpm/" in str(text) else 0.0
    assert read(text, unit).value == pytest.approx(value, rel=digits, abs=0.0)


def test_a_frequency_in_hertz_is_two_pi_radians_per_second() -> None:
    assert read("100 Hz", "rad/s").value == 628.3185307179587
    assert read("6.283185307179586 rad/s", "Hz").value == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("4e-9 m^3/(s Pa)", "m^3/(s Pa^0.5)"),
        ("0.3 m", "Pa"),
        ("628 1/s", "rad/s"),
        ("0.1 rad", ""),
        ("18 S", "s"),
    ],
)
def test_a_wrong_dimension_names_the_one_expected(text: str, unit: str) -> None:
    with pytest.raises(WrongDimensionError) as caught:
        read(text, unit)
    assert DIMENSIONS[unit].name in str(caught.value)
    assert DIMENSIONS[unit].example in str(caught.value)


@pytest.mark.parametrize("raw", [5, 5.0, "5", "0"])
def test_a_bare_number_is_no_length(raw: object) -> None:
    with pytest.raises(QuantityError, match="has no unit"):
        read(raw, "m")


@pytest.mark.parametrize(
    "raw", [True, None, [1], "", "m", "nan m", float("inf"), "1e999 m", "--1 m"]
)
def test_what_is_no_number_is_no_quantity(raw: object) -> None:
    with pytest.raises(QuantityError):
        read(raw, "m")


@pytest.mark.parametrize("unit", ["mpa", "MPaa", "m^^2", "(m", "m/0", "1e3 m", "m^(10^10)", "§"])
def test_an_unknown_unit_is_an_error_and_no_crash(unit: str) -> None:
    with pytest.raises(QuantityError):
        read(f"13.8 {unit}", "Pa")


def test_a_misspelt_unit_suggests_the_right_one() -> None:
    with pytest.raises(QuantityError, match=r"did you mean MPa\?"):
        read("13.8 mpa", "Pa")


@given(st.sampled_from(sorted(DIMENSIONS)), st.floats(allow_nan=False, allow_infinity=False))
def test_an_si_value_written_in_full_reads_back_identically(unit: str, value: float) -> None:
    assert read(f"{value!r} {unit}", unit).value == value


@given(st.sampled_from(sorted(DIMENSIONS)), st.floats(1e-12, 1e12))
def test_a_shown_value_reads_back_as_nearly_itself(unit: str, value: float) -> None:
    assert read(show(value, unit), unit).value == pytest.approx(value, rel=1e-3)


@given(st.text(max_size=30))
def test_no_text_does_worse_than_an_error(text: str) -> None:
    for unit in ("", "Pa"):
        with contextlib.suppress(QuantityError):
            assert isfinite(read(text, unit).value)


def test_every_unit_offered_for_a_dimension_is_of_that_dimension() -> None:
    for si_unit, dimension in DIMENSIONS.items():
        for unit in dimension.units:
            assert unit_factor(unit, si_unit) > 0
        assert read(dimension.example, si_unit).value > 0.0
