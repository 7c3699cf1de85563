"""The transducers count, saturate, make noise and lag as their data sheets say."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.plant import NOMINAL
from rig.plant.dynamics import PlantState
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import DATA_SHEET, READING_COUNT, Reading, SensorParameters, read_sensors
from rig.plant.transducer_effects import transducers

Array = NDArray[np.float64]

QUIET = np.zeros(READING_COUNT)
AT_REST = PlantState(0.0, 0.0, 7e6, 6e6, 0.3, 0.0, 0.0, 13.8e6, 0.0)


def sample(
    state: PlantState = AT_REST,
    leaks: tuple[float, float, float] = (0.0, 0.0, 0.0),
    load: float = 0.0,
    noise: Array = QUIET,
    sensors: SensorParameters = DATA_SHEET,
    meters: Array | None = None,
    offsets: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Reading:
    reading = np.empty(READING_COUNT)
    lag = np.zeros(3) if meters is None else meters
    read_sensors(
        np.array(state), transducers(NOMINAL, np.array(state)), leaks, load, lag,
        np.array(offsets), noise, NOMINAL, sensors, reading,
    )  # fmt: skip
    return Reading(*reading)


@given(st.floats(-0.1, 0.7))
def test_the_encoder_reads_whole_counts_within_half_a_count(position: float) -> None:
    step = DATA_SHEET.position_resolution
    read = sample(AT_REST._replace(position=position)).position
    assert read / step == pytest.approx(round(read / step), abs=1e-6)
    assert abs(read - position) <= 0.5 * step * (1.0 + 1e-9)


@given(st.floats(-1e8, 1e8), st.floats(-5.0, 5.0))
def test_a_pressure_reading_stays_within_the_transducers_range(
    pressure: float, deviation: float
) -> None:
    noise = np.full(READING_COUNT, deviation)
    reading = sample(AT_REST._replace(pressure_1=pressure, pressure_2=pressure), noise=noise)
    for read in (reading.pressure_1, reading.pressure_2):
        assert DATA_SHEET.pressure_min <= read <= DATA_SHEET.pressure_max


def test_a_dry_chamber_reads_as_an_empty_one_however_big_its_cavity() -> None:
    wide = DATA_SHEET._replace(pressure_min=-1e6)
    noise = np.array([0.0, -1.0, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    dry = sample(AT_REST._replace(pressure_1=-5e6, pressure_2=-1.0), noise=noise, sensors=wide)
    assert dry.pressure_1 == -DATA_SHEET.pressure_noise
    assert dry.pressure_2 == 2.0 * DATA_SHEET.pressure_noise


def test_noise_has_the_data_sheets_deviation_on_each_channel() -> None:
    draws = np.random.default_rng(7).standard_normal((4000, READING_COUNT))
    leaks = (2.0 * LITRE_PER_MINUTE,) * 3
    settled = np.array(leaks)
    readings = np.array(
        [sample(load=5e3, leaks=leaks, noise=row, meters=settled.copy()) for row in draws]
    )
    expected = Reading(
        position=0.0,
        pressure_1=DATA_SHEET.pressure_noise,
        pressure_2=DATA_SHEET.pressure_noise,
        spool=DATA_SHEET.spool_noise,
        supply_pressure=DATA_SHEET.supply_pressure_noise,
        load=DATA_SHEET.load_noise,
        flow_1=DATA_SHEET.flow_noise,
        flow_2=DATA_SHEET.flow_noise,
        flow_internal=DATA_SHEET.flow_noise,
    )
    assert readings.std(axis=0) == pytest.approx(np.array(expected), rel=0.05, abs=1e-12)
    middle = Reading(0.3, 7e6, 6e6, 0.0, 13.8e6, 5e3, *leaks)
    tolerance = 0.1 * np.array(expected) + 1e-9
    assert (np.abs(readings.mean(axis=0) - np.array(middle)) <= tolerance).all()
    channels = np.corrcoef(readings[:, 1:].T)
    assert np.abs(channels - np.eye(READING_COUNT - 1)).max() < 0.1


def test_spool_and_load_saturate() -> None:
    reading = sample(AT_REST._replace(spool=1e-3), load=3e4)
    assert reading.spool == DATA_SHEET.spool_range
    assert reading.load == DATA_SHEET.load_max
    reading = sample(AT_REST._replace(spool=-1e-3), load=-10.0)
    assert reading.spool == -DATA_SHEET.spool_range
    assert reading.load == 0.0  # the cell between rod and spring is not pulled


def test_a_flow_meter_sees_no_direction() -> None:
    flow = 0.5 * LITRE_PER_MINUTE
    settled = np.full(3, flow)
    forth = sample(leaks=(flow, flow, flow), meters=settled.copy())
    back = sample(leaks=(flow, flow, -flow), meters=settled.copy())
    assert forth == back
    assert back.flow_internal == pytest.approx(flow)


def test_a_flow_meter_follows_a_step_with_its_lag_and_keeps_its_own_error() -> None:
    flow = 0.8 * LITRE_PER_MINUTE
    meters, offset = np.zeros(3), 0.05 * LITRE_PER_MINUTE
    ticks = round(DATA_SHEET.flow_time_constant / TICK)
    reading = [
        sample(leaks=(flow, 0.0, 0.0), meters=meters, offsets=(offset, offset, -offset))
        for _ in range(ticks)
    ][-1]
    assert reading.flow_1 - offset == pytest.approx(flow * (1.0 - np.exp(-1.0)), rel=1e-9)
    assert reading.flow_2 == pytest.approx(offset)
    assert reading.flow_internal == 0.0  # a meter shows no flow rather than a negative one
