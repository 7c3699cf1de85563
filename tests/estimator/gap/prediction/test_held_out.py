"""The noise floor of the held-out gap is the same for fits that differ in their last digits."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.held_out import channel_gaps, rounded
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.results import GapResult
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from tools.simulated.recordings import recorded_healthy

PLANT = servo_actuator(Model())
CHANNELS = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")


def test_only_fitted_values_are_rounded_and_to_four_digits() -> None:
    given = {"a": 1.23456789, "b": 9.87654321, "c": 0.0, "d": np.inf}
    fitted = {"a": 1.23456789, "b": 9.87612345e8, "c": -3.33333e-6, "d": 2.0}
    assert rounded(fitted, given) == {"a": 1.23456789, "b": 9.876e8, "c": -3.333e-6, "d": 2.0}
    assert rounded(given, given) == given


def test_the_eighth_digit_of_a_fit_changes_no_floor_although_the_ram_sticks_and_slips() -> None:
    time_s = TICK * np.arange(3000)
    recording = recorded_healthy(NOMINAL, 0.3 + 2e-3 * np.sin(3.0 * time_s), False, 1)
    record = record_of(Recording({name: recording[name] for name in CHANNELS}), PLANT)
    predictor, given = Predictor(PLANT), PLANT.nominal
    fits = [
        {**given, "bulk_modulus": 7.0012345e8 * change, "viscous": 351.23456 * change}
        for change in (1.0, 1.0 + 1e-8)
    ]
    with ThreadPoolExecutor(2) as pool:
        one, other = (channel_gaps(predictor, [record], given, fit, pool) for fit in fits)
    assert [gap.floor for gap in one] == [gap.floor for gap in other]
    assert [gap.after for gap in one] != [gap.after for gap in other]
    assert [gap.after for gap in one] == pytest.approx([gap.after for gap in other], rel=1e-4)
    result = GapResult("adequate", [], channels=one)
    assert result.gap_scatter == pytest.approx(np.mean([gap.scatter for gap in one]))


def test_a_gap_that_was_not_measured_has_no_scatter() -> None:
    assert np.isnan(GapResult("inconclusive", []).gap_scatter)
