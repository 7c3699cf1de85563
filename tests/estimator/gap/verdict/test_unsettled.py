"""What names leave counts where it goes with the motion, whether or not a law could tell it."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gap.plant.records import Record, made_of, record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.search.disturbances import attribution, places_of
from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.verdict.unsettled import Unsettled, compared, unsettled
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from tools.simulated.recordings import recorded_healthy

Array = NDArray[np.float64]
PLANT = servo_actuator(Model())
CHANNELS = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")
SPOOL = 3
LEAK = 4e-9


@pytest.fixture(scope="module")
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as threads:
        yield threads


@pytest.fixture(scope="module")
def twin(pool: ThreadPoolExecutor) -> Record:
    """12 s of a rig that is the model, driven to and fro with rests between."""
    time_s = TICK * np.arange(12000)
    asked = np.where(time_s % 3.0 < 1.5, 0.05 * np.sin(8.0 * time_s), 0.0)
    whole = recorded_healthy(NOMINAL, 0.3 + asked, False, 1)
    return record_of(Recording({name: whole[name] for name in CHANNELS}), PLANT)


def left_of(record: Record, pool: ThreadPoolExecutor) -> list[Unsettled]:
    predictor = Predictor(PLANT)
    of_record, *twins = (
        Fitter(predictor, [each], pool).filtered(PLANT.nominal)
        for each in (record, *(predictor.twin(record, PLANT.nominal, seed) for seed in (5, 6)))
    )
    return compared(unsettled(of_record, twins, PLANT.nominal), of_record, PLANT.nominal)


def with_spool(record: Record, error: Array) -> Record:
    readings = record.readings.copy()
    readings[:, SPOOL] += error
    return made_of("changed", record.inputs, readings, PLANT)


def test_a_rig_that_is_the_model_leaves_nothing(twin: Record, pool: ThreadPoolExecutor) -> None:
    assert not any(channel.counts for channel in left_of(twin, pool))


def test_chance_that_goes_with_the_command_counts(twin: Record, pool: ThreadPoolExecutor) -> None:
    rate = np.abs(np.gradient(twin.inputs[:, 0], TICK))
    error = 1e-7 * rate * np.random.default_rng(2).standard_normal(len(rate))
    spool = left_of(with_spool(twin, error), pool)[SPOOL]
    assert spool.counts
    assert (spool.region, spool.unit) == ("rate of command_V", "V/s")
    assert int(np.argmax(spool.values)) == len(spool.values) - 1


def test_a_sensor_noisier_than_stated_does_not(twin: Record, pool: ThreadPoolExecutor) -> None:
    error = 1e-6 * np.random.default_rng(2).standard_normal(len(twin))
    spool = left_of(with_spool(twin, error), pool)[SPOOL]
    assert spool.mean > 0.5
    assert not spool.counts


def test_an_opening_between_the_chambers_is_found_across_the_piston(
    pool: ThreadPoolExecutor,
) -> None:
    time_s = TICK * np.arange(8000)
    setpoint = 0.3 + 0.05 * np.sin(4.0 * time_s)
    whole = recorded_healthy(NOMINAL._replace(internal_leakage=LEAK), setpoint, False, 1)
    record = record_of(Recording({name: whole[name] for name in CHANNELS}), PLANT)
    filtered = Fitter(Predictor(PLANT), [record], pool).filtered(PLANT.nominal)
    found = attribution(filtered, PLANT.nominal, ())
    (across,) = (each for each in places_of(PLANT) if each.name == "leak across the piston")
    curve = found.curve(across, "position", 1.0)
    assert curve is not None
    assert curve.share > 0.9
    assert curve.values[2:-2] == pytest.approx(np.full(5, LEAK), rel=0.1)
