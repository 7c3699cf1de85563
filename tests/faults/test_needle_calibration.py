"""What a flow meter and a pressure drop show of a needle valve, and how sure it is."""

from datetime import date

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from control.request import RequestError
from faults.bypass import NOMINAL_BYPASSES, BypassValve
from faults.needle import BypassError, NeedleCharacteristic
from faults.needle_calibration import (
    CalibrationError,
    Estimate,
    Measurement,
    NeedleCalibration,
    UnsettledError,
    calibrated_needle,
    measured_coefficient,
    meter_zero,
    settled,
)

Array = NDArray[np.float64]

BATCH = 500
SAMPLES = 12 * BATCH
READING = 100
"""Samples from one reading of a meter to the next."""
LITRE_PER_MINUTE = 1e-3 / 60.0
NOISE = 0.02 * LITRE_PER_MINUTE
NO_ERROR = Estimate(0.0, 0.0)
DAY = date(2026, 3, 2)
VALVE = NOMINAL_BYPASSES["internal_leakage"]

coefficients = st.floats(1e-11, 5e-8)
drops = st.floats(5e5, 1.4e7)


def metered(flow: float | Array, offset: float, rng: np.random.Generator, samples: int) -> Array:
    """Return what a meter reads of a flow: a fixed error, noise, nothing below zero."""
    noise = np.repeat(NOISE * rng.standard_normal(samples // READING), READING)
    return np.maximum(flow + offset + noise, 0.0)


@given(coefficients, drops, st.floats(0.0, 1e-5), st.sampled_from([-1.0, 1.0]))
def test_the_coefficient_is_flow_by_root_of_drop_whatever_its_sign(
    coefficient: float, drop: float, zero: float, sign: float
) -> None:
    flow = np.full(SAMPLES, coefficient * np.sqrt(drop) + zero)
    reported, found, mean_drop = measured_coefficient(
        flow, np.full(SAMPLES, sign * drop), Estimate(zero, 0.0), BATCH
    )
    assert found.value == pytest.approx(coefficient, rel=1e-6, abs=1e-15)
    assert reported.value == pytest.approx(coefficient * np.sqrt(drop), rel=1e-6, abs=1e-12)
    assert mean_drop == pytest.approx(drop, rel=1e-9)


def test_errors_are_as_large_as_they_are_said_to_be() -> None:
    misses = []
    true = 2e-9
    for seed in range(300):
        rng = np.random.default_rng(seed)
        zero = meter_zero(metered(0.0, 3.0 * NOISE, rng, 4 * SAMPLES), BATCH)
        drop = 3e6 + 3e4 * rng.standard_normal(SAMPLES)
        flow = metered(true * np.sqrt(3e6), 3.0 * NOISE, rng, SAMPLES)
        _, found, _ = measured_coefficient(flow, drop, zero, BATCH)
        misses.append((found.value - true) / found.standard_error)
    within = np.mean(np.abs(misses) <= 2.0)
    assert 0.90 <= within <= 0.98
    assert abs(np.mean(misses)) <= 0.15


def test_noise_that_a_meter_cuts_off_at_zero_is_no_flow_and_hardly_lifts_the_zero() -> None:
    offset, rng = 0.25 * NOISE, np.random.default_rng(1)
    flow = metered(0.0, offset, rng, 200 * BATCH)
    zero = meter_zero(flow, BATCH)
    assert abs(zero.value - offset) < 0.5 * abs(flow.mean() - offset)
    nothing = metered(0.0, offset, rng, 200 * BATCH)
    reported, _, _ = measured_coefficient(nothing, np.full(nothing.size, 4e6), zero, BATCH)
    assert abs(reported.value) <= 3.0 * reported.standard_error


def test_missing_samples_count_for_nothing() -> None:
    flow, drop = np.full(SAMPLES, 1e-5), np.full(SAMPLES, 4e6)
    flow[::3], drop[1::7] = np.nan, np.nan
    _, found, _ = measured_coefficient(flow, drop, NO_ERROR, BATCH)
    assert found.value == pytest.approx(5e-9)
    assert meter_zero(flow, BATCH).value == 1e-5


def test_what_comes_before_the_flow_has_settled_is_left_out() -> None:
    rng = np.random.default_rng(2)
    time = 1e-3 * np.arange(SAMPLES)
    flow = metered(2e-5 * (1.0 - np.exp(-time / 0.3)), 0.0, rng, SAMPLES)
    reported, _, _ = measured_coefficient(flow, np.full(SAMPLES, 4e6), NO_ERROR, BATCH)
    assert abs(reported.value - 2e-5) <= 3.0 * reported.standard_error


@given(st.floats(1e-12, 1.0), st.integers(6, 40))
def test_a_drift_is_not_settled(slope: float, count: int) -> None:
    with pytest.raises(UnsettledError):
        settled(slope * np.arange(3 * count, dtype=float))


@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=40))
def test_what_is_settled_is_the_end_and_at_least_half_of_what_was_measured(
    values: list[float],
) -> None:
    try:
        kept = settled(np.array(values))
    except UnsettledError:
        return
    assert list(kept) == values[-kept.size :]
    assert 2 * kept.size >= len(values)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_of_fewer_than_three_values_it_cannot_be_said_that_they_are_settled(count: int) -> None:
    with pytest.raises(UnsettledError):
        settled(np.ones(count))


def test_what_does_not_change_is_settled() -> None:
    assert settled(np.ones(3)).size == 3
    assert settled(np.full(8, 0.1)).size == 8


def measurement(
    opening: float, coefficient: float, *, upwards: bool = True, error: float = 1e-12,
    drop_Pa: float = 3e6,  # noqa: N803
) -> Measurement:  # fmt: skip
    flow = Estimate(coefficient * np.sqrt(drop_Pa), error * np.sqrt(drop_Pa))
    return Measurement(opening, upwards, opening, flow, drop_Pa, Estimate(coefficient, error))


def calibration(*points: tuple[float, float], valve: BypassValve = VALVE) -> NeedleCalibration:
    return calibrated_needle(valve, [measurement(*point) for point in points], DAY)


@given(st.floats(5e-4, 1e-2), st.floats(1e-9, 5e-8))
def test_the_share_of_the_ball_valve_is_taken_out(bore_m: float, maximum: float) -> None:
    needle = NeedleCharacteristic.from_table([(0.0, 0.0), (1.0, maximum)])
    valve = BypassValve("bypass", 0.5, needle, bore_m)
    found = calibration((0.0, 0.0), (1.0, valve.maximum), valve=valve)
    assert found.needle.maximum == pytest.approx(maximum, rel=1e-6)
    # An error of the whole counts for more in the part that the ball hides.
    assert found.points[-1].coefficient.standard_error >= 1e-12


def test_a_needle_is_calibrated_up_and_down_and_the_difference_is_shown() -> None:
    measured = [
        measurement(opening, coefficient, upwards=upwards)
        for opening, coefficient, upwards in [
            (0.0, 1e-10, True), (0.5, 4.2e-9, True), (1.0, 2e-8, True),
            (1.0, 2e-8, False), (0.5, 3.8e-9, False), (0.0, 1e-10, False),
        ]
    ]  # fmt: skip
    found = calibrated_needle(VALVE, measured, DAY)
    assert found.needle.coefficient(0.5) == pytest.approx(4e-9, rel=1e-3)
    assert [point.hysteresis for point in found.points] == pytest.approx(
        [0.0, 4e-10, 0.0], rel=1e-3
    )
    assert (found.needle.date, found.needle.id) == (DAY, "internal_leakage, 2026-03-02")


def test_what_the_meter_does_not_resolve_is_left_out_and_bounded() -> None:
    found = calibration((0.0, 1e-12), (0.1, -1e-12), (0.2, 2e-10), (1.0, 2e-8))
    assert found.needle.openings == (0.0, 0.2, 1.0)
    assert found.needle.minimum == 0.0
    assert [point.bound for point in found.points[:2]] == pytest.approx([3e-12, 2e-12], rel=1e-6)


def test_a_shut_needle_that_leaks_is_reported() -> None:
    assert calibration((0.0, 5e-11), (1.0, 2e-8)).needle.minimum == pytest.approx(5e-11)


@pytest.mark.parametrize(
    ("measured", "error", "reported"),
    [
        (
            [measurement(0.0, 0.0), measurement(0.5, 9e-9), measurement(1.0, 8e-9)],
            BypassError,
            "coefficients[2]: 8",
        ),
        (
            [measurement(0.0, 0.0), measurement(1.0, 2e-12)],
            CalibrationError,
            "opening 1: 2e-12 +- 1e-12 m^3/(s Pa^0.5) cannot be told from no flow",
        ),
        (
            [measurement(0.0, 0.0, drop_Pa=2e5), measurement(1.0, 2e-8)],
            CalibrationError,
            "opening 0: 0.20 MPa is less drop than the 0.3 MPa",
        ),
        (
            [measurement(0.0, 0.0), measurement(1.0, 1e-6)],
            CalibrationError,
            "opening 1: 1e-06 m^3/(s Pa^0.5) is more than the open ball passes",
        ),
    ],
)
def test_measurements_that_are_no_calibration_are_refused_with_the_reason(
    measured: list[Measurement], error: type[RequestError], reported: str
) -> None:
    with pytest.raises(error) as caught:
        calibrated_needle(VALVE, measured, DAY)
    assert "internal_leakage" in str(caught.value)
    assert reported in str(caught.value)
