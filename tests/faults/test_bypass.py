"""What a bypass of ball valve and needle valve passes, and how it is set to a leak."""

from datetime import date
from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from faults.bypass import (
    NOMINAL_BYPASSES,
    BypassValve,
    bore_coefficient,
    port_opening,
    series_coefficient,
)
from faults.leakage import square_root_flow, to_litres_per_minute
from faults.needle import BypassError, NeedleCharacteristic
from faults.verdict import LEAK_KINDS, Verdict

EQUAL_PERCENTAGE = NeedleCharacteristic.equal_percentage(2.6e-8, 50.0)

shares = st.floats(0.0, 1.0)
coefficients = st.floats(1e-12, 1e-5)

Array = NDArray[np.float64]


@st.composite
def calibrations(draw: st.DrawFn) -> NeedleCharacteristic:
    """Draw a table as uneven as one may be: steps of a hundredth, coefficients of 1 in 10^4."""
    count = draw(st.integers(1, 30))
    steps = np.array(draw(st.lists(st.floats(1.0, 50.0), min_size=count, max_size=count)))
    powers = np.array(draw(st.lists(st.floats(-2.0, 2.0), min_size=count, max_size=count)))
    start = draw(st.sampled_from([0.0, 1e-3, 1.0]))
    rises = 10.0**powers
    openings = _added_up(0.0, steps / steps.sum(), 0.0101)
    coefficients = _added_up(start, rises, 1.01e-4)
    maximum = draw(st.floats(1e-10, 1e-7))
    return NeedleCharacteristic(tuple(openings), tuple(maximum * coefficients))


def _added_up(start: float, steps: Array, least: float) -> Array:
    """Return the sums of a start and positive steps, scaled so that the last is 1.

    No step is below `least`.
    """
    parts = np.array([start, *steps]) * (1.0 - len(steps) * least) / (start + steps.sum())
    sums = np.cumsum(parts + least * (np.arange(len(parts)) > 0))
    sums[-1] = 1.0
    return np.asarray(sums)


bypasses = st.builds(
    BypassValve,
    name=st.just("bypass"),
    ball_travel_s=st.floats(0.0, 2.0),
    needle=calibrations(),
    ball_bore_m=st.floats(2e-3, 2e-2),
)


@given(calibrations(), shares)
def test_every_coefficient_of_a_needle_belongs_to_one_opening(
    needle: NeedleCharacteristic, share: float
) -> None:
    wanted = needle.minimum + share * (needle.maximum - needle.minimum)
    wanted = min(wanted, needle.maximum)
    assert needle.coefficient(needle.opening(wanted)) == pytest.approx(wanted, rel=1e-9)


@given(calibrations(), shares)
def test_every_opening_of_a_needle_is_found_from_its_coefficient(
    needle: NeedleCharacteristic, opening: float
) -> None:
    found = needle.opening(needle.coefficient(opening))
    assert found == pytest.approx(opening, rel=1e-9, abs=1e-12)


@given(calibrations(), shares, shares)
def test_a_needle_opened_further_never_passes_less(
    needle: NeedleCharacteristic, one: float, other: float
) -> None:
    less, more = sorted((one, other))
    assert needle.coefficient(less) <= needle.coefficient(more)


def test_a_needle_passes_what_its_calibration_measured() -> None:
    points = [(1.0, 2.6e-8), (0.0, 1e-10), (0.5, 4e-9), (0.25, 1e-9)]
    needle = NeedleCharacteristic.from_table(points, date(2024, 5, 3), "needle 7")
    for opening, coefficient in points:
        assert needle.coefficient(opening) == pytest.approx(coefficient, rel=1e-12)
    assert (needle.date, needle.id) == (date(2024, 5, 3), "needle 7")
    assert (needle.minimum, needle.maximum) == (1e-10, 2.6e-8)


def test_an_equal_percentage_needle_shuts_fully_and_opens_to_its_maximum() -> None:
    assert EQUAL_PERCENTAGE.coefficient(0.0) == 0.0
    assert EQUAL_PERCENTAGE.coefficient(1.0) == 2.6e-8
    assert EQUAL_PERCENTAGE.opening(0.0) == 0.0
    assert EQUAL_PERCENTAGE.opening(2.6e-8) == 1.0


def test_equal_turns_of_an_equal_percentage_needle_add_equal_percentages() -> None:
    openings = np.linspace(0.0, 1.0, 11)
    passed = np.array([EQUAL_PERCENTAGE.coefficient(opening) for opening in openings])
    growth = np.diff(passed)[1:] / np.diff(passed)[:-1]
    np.testing.assert_allclose(growth, 50.0**0.1, rtol=1e-9)


def test_the_gain_of_a_needle_grows_by_its_rangeability() -> None:
    slope = np.diff(EQUAL_PERCENTAGE.coefficients) / np.diff(EQUAL_PERCENTAGE.openings)
    assert slope[-1] / slope[0] == pytest.approx(50.0 ** (49 / 50))


@pytest.mark.parametrize("rangeability", [1.001, 30.0, 1000.0])
def test_needles_of_every_usual_rangeability_can_be_described(rangeability: float) -> None:
    needle = NeedleCharacteristic.equal_percentage(1e-8, rangeability)
    expected = 1e-8 * (rangeability**0.5 - 1.0) / (rangeability - 1.0)
    assert needle.coefficient(0.5) == pytest.approx(expected, rel=3e-3)


@pytest.mark.parametrize(
    ("openings", "coefficients", "named"),
    [
        ((0.0, 1.0), (0.0,), ["coefficients"]),
        ((0.0,), (0.0,), ["coefficients"]),
        ((0.1, 0.9), (0.0, 1e-8), ["openings", "openings"]),
        ((0.0, 0.5, 0.5, 1.0), (0.0, 1e-9, 2e-9, 1e-8), ["openings[2]"]),
        ((0.0, 0.5, 1.0), (0.0, 2e-8, 1e-8), ["coefficients[2]"]),
        ((0.0, 0.5, 1.0), (0.0, 1e-13, 1e-8), ["coefficients[1]"]),
        ((0.0, 1.0), (-1e-9, 1e-8), ["coefficients"]),
        ((0.0, nan, 1.0), (0.0, 1e-9, 1e-8), ["openings[1]", "openings[2]"]),
        ((0.0, 1.0), (0.0, inf), ["coefficients"]),
    ],
)
def test_a_table_that_cannot_be_inverted_is_refused(
    openings: tuple[float, ...], coefficients: tuple[float, ...], named: list[str]
) -> None:
    with pytest.raises(BypassError) as error:
        NeedleCharacteristic(openings, coefficients)
    assert [problem.field for problem in error.value.problems] == named


@pytest.mark.parametrize(
    ("maximum", "rangeability", "named"),
    [(0.0, 1.0, ["maximum", "rangeability"]), (1e-8, 2000.0, ["rangeability"])],
)
def test_an_impossible_equal_percentage_needle_is_refused(
    maximum: float, rangeability: float, named: list[str]
) -> None:
    with pytest.raises(BypassError) as error:
        NeedleCharacteristic.equal_percentage(maximum, rangeability)
    assert [problem.field for problem in error.value.problems] == named


@given(coefficients, coefficients)
def test_two_valves_in_series_pass_less_than_either(one: float, other: float) -> None:
    both = series_coefficient(one, other)
    assert 0.0 < both <= min(one, other)
    if max(one, other) < 1e6 * min(one, other):
        assert both < min(one, other)
    assert both == series_coefficient(other, one)


@given(coefficients, coefficients, st.floats(1e3, 2e7))
def test_the_drops_of_two_valves_in_series_add_up(one: float, other: float, drop: float) -> None:
    flow = square_root_flow(series_coefficient(one, other), drop)
    assert (flow / one) ** 2 + (flow / other) ** 2 == pytest.approx(drop, rel=1e-9)


def test_a_shut_valve_shuts_the_series() -> None:
    passed = series_coefficient(np.array([0.0, 0.0, 1e-8]), np.array([0.0, 1e-8, 0.0]))
    assert passed.tolist() == [0.0, 0.0, 0.0]


def test_a_ball_valve_opens_from_nothing_to_its_whole_bore() -> None:
    opened = port_opening(np.linspace(0.0, 1.0, 1001))
    assert (opened[0], opened[-1]) == (0.0, 1.0)
    assert np.all(np.diff(opened) > 0.0)


def test_a_half_turned_ball_frees_the_overlap_of_its_bore_and_seat() -> None:
    # Two unit circles one radius apart share 2 pi/3 - sqrt(3)/2 (Lighthill's lens), of pi.
    assert port_opening(0.5) == pytest.approx((2 * np.pi / 3 - 0.75**0.5) / np.pi)


def test_the_open_ball_hardly_counts_beside_the_needle() -> None:
    for bypass in NOMINAL_BYPASSES.values():
        assert 0.99 * bypass.needle.maximum < bypass.maximum < bypass.needle.maximum
    # 6 mm across, C_d = 0.6, mineral oil: 28.3 mm^2 pass 0.6 * 0.0486 m^3/(s Pa^0.5) each m^2.
    assert bore_coefficient(6e-3) == pytest.approx(0.6 * 28.274e-6 * 0.04859, rel=1e-3)


@given(bypasses, shares, shares)
def test_a_bypass_passes_no_more_than_its_needle(
    bypass: BypassValve, opening: float, position: float
) -> None:
    passed = bypass.effective(opening, position)
    assert 0.0 <= passed <= bypass.needle.coefficient(opening)
    assert passed <= bypass.ball_coefficient * port_opening(position)
    assert passed <= bypass.effective(opening)
    assert passed <= bypass.maximum


@given(bypasses, shares)
def test_a_bypass_can_be_set_to_any_leak_within_its_reach(
    bypass: BypassValve, share: float
) -> None:
    wanted = bypass.minimum + share * (bypass.maximum - bypass.minimum)
    opening = bypass.needle_opening_for(wanted)
    assert 0.0 <= opening <= 1.0
    assert bypass.effective(opening) == pytest.approx(wanted, rel=1e-8)


def test_a_shut_ball_stops_any_leak() -> None:
    assert all(bypass.effective(1.0, 0.0) == 0.0 for bypass in NOMINAL_BYPASSES.values())


@pytest.mark.parametrize("kind", LEAK_KINDS)
def test_the_actuators_bypasses_pass_four_litres_a_minute_at_half_supply(kind: Verdict) -> None:
    flow = to_litres_per_minute(square_root_flow(NOMINAL_BYPASSES[kind].maximum, 6.9e6))
    assert 4.0 < flow < 4.2


def test_the_supply_bypass_passes_twenty_litres_a_minute() -> None:
    bypass = NOMINAL_BYPASSES["supply_leakage"]
    assert 20.0 < to_litres_per_minute(square_root_flow(bypass.maximum, 13.8e6)) < 21.0


def test_a_leak_beyond_the_bypass_is_refused_with_what_it_can_do() -> None:
    bypass = NOMINAL_BYPASSES["internal_leakage"]
    with pytest.raises(BypassError) as error:
        bypass.needle_opening_for(3e-8)
    assert str(error.value) == (
        "internal_leakage coefficient: 3e-08 m^3/(s Pa^0.5) is above 2.599e-08, the most it passes"
        " (4.1 L/min at 6.9 MPa); ask for a smaller leak or fit a larger needle"
    )
    (problem,) = error.value.problems
    assert (problem.where, problem.field) == ("internal_leakage", "coefficient")


def test_a_leak_below_what_a_worn_needle_shuts_is_refused() -> None:
    worn = NeedleCharacteristic((0.0, 1.0), (1e-9, 1e-8))
    with pytest.raises(BypassError, match="shut the ball valve instead"):
        BypassValve("external_leakage_1", 0.5, worn).needle_opening_for(5e-10)


@pytest.mark.parametrize("coefficient", [-1e-9, nan, inf])
def test_a_leak_that_is_no_number_is_refused(coefficient: float) -> None:
    with pytest.raises(BypassError, match="supply_leakage coefficient"):
        NOMINAL_BYPASSES["supply_leakage"].needle_opening_for(coefficient)
    with pytest.raises(BypassError, match="coefficient"):
        EQUAL_PERCENTAGE.opening(coefficient)


@pytest.mark.parametrize("share", [-0.1, 1.1, nan])
def test_valves_open_from_0_to_1(share: float) -> None:
    with pytest.raises(BypassError) as error:
        NOMINAL_BYPASSES["supply_leakage"].effective(share, share)
    assert [p.field for p in error.value.problems] == ["needle_opening", "ball_position"]
    with pytest.raises(BypassError, match="opening"):
        EQUAL_PERCENTAGE.coefficient(share)


def test_a_bypass_that_cannot_exist_is_refused_with_every_reason() -> None:
    with pytest.raises(BypassError) as error:
        BypassValve("external_leakage_2", -1.0, EQUAL_PERCENTAGE, ball_bore_m=6.0)
    assert [p.field for p in error.value.problems] == ["ball_travel_s", "ball_bore_m"]
