"""What a transducer indicated becomes what it should have, by its calibration."""

from dataclasses import replace
from datetime import date, timedelta
from itertools import pairwise
from math import isnan, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.io.correction import corrections_of
from rig.io.signals import FAST_INPUTS
from rig.io.transducer_calibration import (
    CalibrationPoint,
    TransducerCalibration,
    calibration_doubts,
)

CALIBRATION = TransducerCalibration(
    "pressure_1_Pa",
    "PT-1",
    date(2026, 3, 2),
    date(2027, 3, 2),
    (CalibrationPoint(0.0, 2e4), CalibrationPoint(5e6, 5.1e6), CalibrationPoint(2e7, 1.98e7)),
)


@pytest.mark.parametrize(
    ("indicated", "reference"),
    [(2e4, 0.0), (5.1e6, 5e6), (1.98e7, 2e7), (2.56e6, 2.5e6), (1.245e7, 1.25e7)],
)
def test_between_its_points_the_correction_is_linear(indicated: float, reference: float) -> None:
    assert CALIBRATION.corrected(indicated) == pytest.approx(reference)


def test_beyond_the_points_the_correction_is_that_of_the_last_one() -> None:
    assert CALIBRATION.corrected(2.09e7) == pytest.approx(2.11e7)
    assert CALIBRATION.corrected(-1e5) == pytest.approx(-1.2e5)


def test_a_missing_reading_stays_missing() -> None:
    assert isnan(CALIBRATION.corrected(nan))


@given(st.lists(st.floats(-1e7, 4e7), min_size=2, max_size=20))
def test_a_corrected_reading_rises_with_what_is_indicated(indicated: list[float]) -> None:
    corrected = [CALIBRATION.corrected(value) for value in sorted(indicated)]
    # Rounding may turn two readings that differ in the last bits round.
    assert all(below <= above + 1e-8 for below, above in pairwise(corrected))


def test_the_largest_correction_has_its_sign() -> None:
    assert CALIBRATION.largest_correction == pytest.approx(2e5)
    halved = replace(CALIBRATION, points=CALIBRATION.points[:2])
    assert halved.largest_correction == pytest.approx(-1e5)


def test_the_loop_takes_the_calibrations_of_the_fast_channels_only() -> None:
    slow = replace(CALIBRATION, channel="oil_temperature_K")
    load = replace(CALIBRATION, channel="load_N", points=CALIBRATION.points[1:])
    taken = corrections_of([slow, CALIBRATION, load])
    assert [FAST_INPUTS[index] for index in taken.inputs] == ["pressure_1_Pa", "load_N"]
    assert taken.first.tolist() == [0, 3, 5]
    assert np.array_equal(taken.corrections, [-2e4, -1e5, 2e5, -1e5, 2e5])


def test_a_calibration_holds_on_its_first_and_on_its_last_day() -> None:
    day = timedelta(days=1)
    assert not CALIBRATION.doubt(CALIBRATION.date)
    assert not CALIBRATION.doubt(CALIBRATION.valid_until)
    assert CALIBRATION.doubt(CALIBRATION.date - day) == "is not valid before 2026-03-02"
    assert CALIBRATION.doubt(CALIBRATION.valid_until + day) == "expired on 2027-03-02"


def test_a_calibration_is_named_before_it_expires() -> None:
    last, month = CALIBRATION.valid_until, timedelta(days=30)
    assert not list(calibration_doubts([CALIBRATION], last))
    assert not list(calibration_doubts([CALIBRATION], last - month, month))
    (soon,) = calibration_doubts([CALIBRATION], last - timedelta(days=29), month)
    assert soon.startswith("the calibration of pressure_1_Pa (transducer PT-1) expires in 29 days")
    (now,) = calibration_doubts([CALIBRATION], last, month)
    assert "expires today" in now
