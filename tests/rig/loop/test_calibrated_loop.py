"""The loop takes readings that its transducers' calibrations have corrected."""

from datetime import date
from math import nan
from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.filters.registry import OUTPUTS, run_filter, start_memory
from rig.io.correction import Corrections, corrections_of
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS
from rig.io.simulated import simulated_rig
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.jit import njit
from rig.loop.interlocks.check_tolerances import tolerances
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.loop.wire.scaling import bring_to_scale
from rig.plant import NO_FAULT, Model
from rig.plant.integrator import TICK
from rig.plant.parameters import NOMINAL
from rig.plant.sensors import DATA_SHEET

Array = NDArray[np.float64]

BIAS_PA: Final = 3e5
SPAN: Final = 1.02
TICKS: Final = 1000


def indicated(reference: float) -> float:
    """Return what the transducer of chamber 1 indicates, in Pa."""
    return SPAN * reference + BIAS_PA


CALIBRATION: Final = TransducerCalibration(
    "pressure_1_Pa",
    "PT-1",
    date(2026, 3, 2),
    date(2027, 3, 2),
    tuple(CalibrationPoint(value, indicated(value)) for value in (0.0, 1e7, 2e7)),
)


def recorded(*calibrations: TransducerCalibration) -> dict[str, Array]:
    """Return what a second records of a rig whose transducer of chamber 1 errs."""
    model = Model().with_effect("pressure_1_gain", value=SPAN)
    rig = simulated_rig(model.with_effect("pressure_1_bias", value=BIAS_PA), 1)
    rig.corrections = corrections_of(calibrations)
    faults = np.tile(np.array(NO_FAULT), (TICKS, 1))
    setpoint = 0.3 + 0.05 * np.sin(6.0 * np.arange(TICKS) * TICK)
    memory = start_memory("product", Model())
    loop = SimulatedLoop(rig, Motion(setpoint, False, faults, 0.3, 300), memory, NOMINAL)
    loop.position()
    rows = loop.advance(TICKS)
    return dict(zip(loop.channels, rows.T.copy(), strict=True))


def test_a_transducer_whose_error_is_calibrated_reads_the_truth() -> None:
    off = recorded()
    error = off["pressure_1_Pa"] - off["true_pressure_1_Pa"]
    assert error.mean() > BIAS_PA
    right = recorded(CALIBRATION)
    error = right["pressure_1_Pa"] - right["true_pressure_1_Pa"]
    # Four standard errors of the mean of so many samples.
    assert abs(error.mean()) < 4.0 * DATA_SHEET.pressure_noise / np.sqrt(TICKS)
    estimated = right["est_pressure_1_Pa"] - right["true_pressure_1_Pa"]
    assert abs(estimated[500:].mean()) < 0.1 * BIAS_PA


def test_other_channels_stay_as_they_are() -> None:
    off, right = recorded(), recorded(CALIBRATION)
    for channel in ("position_m", "pressure_2_Pa", "supply_pressure_Pa", "load_N"):
        assert np.array_equal(off[channel], right[channel])


def test_what_is_recorded_is_corrected_so_that_a_replay_takes_it_as_it_is() -> None:
    right = recorded(CALIBRATION)
    measured = [
        right[f"{name}"] for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
    ]
    measured.append(right["supply_pressure_Pa"])
    again = run_filter(right["time_s"], right["command_V"], np.column_stack(measured), Model())
    for index, name in enumerate(OUTPUTS):
        assert np.array_equal(again.outputs[:, index], right[name], equal_nan=True)


@njit(error_model="numpy")
def scaled(inputs: Array, offset: float, corrections: Corrections) -> None:
    """Call the part of the loop on the wire, which Python cannot call."""
    bring_to_scale(inputs, offset, corrections)


def test_on_the_wire_a_sample_is_corrected_before_anything_sees_it() -> None:
    values = np.linspace(-1e6, 2.2e7, 50)
    inputs = np.full(len(FAST_INPUTS), nan)
    inputs[FAST_INPUTS.index("position_m")] = 0.1
    for value in values:
        inputs[FAST_INPUTS.index("pressure_1_Pa")] = value
        inputs[FAST_INPUTS.index("pressure_2_Pa")] = value
        inputs[FAST_INPUTS.index("position_m")] = 0.1
        scaled(inputs, 0.2, corrections_of([CALIBRATION]))
        assert inputs[FAST_INPUTS.index("pressure_1_Pa")] == CALIBRATION.corrected(value)
        assert inputs[FAST_INPUTS.index("pressure_2_Pa")] == value
        assert inputs[FAST_INPUTS.index("position_m")] == pytest.approx(0.3)
    inputs[:] = nan
    scaled(inputs, 0.2, corrections_of([CALIBRATION]))
    assert np.isnan(inputs).all()


def test_a_transducer_at_its_rail_is_known_by_the_corrected_rail() -> None:
    def highest(*calibrations: TransducerCalibration) -> float:
        tol = tolerances(
            NOMINAL, DATA_SHEET, frozenset(), TICK, 0.1, HomingSettings(), 10.0, calibrations
        )
        return float(tol.range_high[FAST_INPUTS.index("pressure_1_Pa")])

    assert highest() == DATA_SHEET.pressure_max
    assert highest(CALIBRATION) == CALIBRATION.corrected(DATA_SHEET.pressure_max)
    assert highest(CALIBRATION) < DATA_SHEET.pressure_max - BIAS_PA
