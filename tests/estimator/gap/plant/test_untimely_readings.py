"""What a loop on hardware could not read, or read late, is no evidence against a model."""

import numpy as np
import pytest

from estimator.gap.plant.records import record_of, untimely
from estimator.gap.servo.actuator import servo_actuator
from rig.plant import Model
from rig.recording import Recording

N = 200
LATE, MISSED = 60, slice(100, 104)


@pytest.fixture
def recording() -> Recording:
    time = np.arange(N) * 1e-3
    sent, took = np.full(N, 5e-5), np.full(N, 9e-5)
    sent[LATE] += 4e-4
    channels = {
        "time_s": time,
        "command_V": np.sin(time),
        "position_m": 0.3 + 0.01 * time,
        "pressure_1_Pa": np.full(N, 6.9e6),
        "pressure_2_Pa": np.full(N, 6.8e6),
        "spool_m": np.full(N, 1e-6),
        "sent_s": sent,
        "exchange_s": took,
    }
    for name in ("position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m", "sent_s", "exchange_s"):
        channels[name][MISSED] = np.nan
    return Recording(channels)


def test_a_late_exchange_and_a_missed_tick_are_left_out_and_nothing_else(
    recording: Recording,
) -> None:
    record = record_of(recording, servo_actuator(Model()))
    left_out = ~np.isfinite(record.variances)
    expected = np.zeros(N, dtype=bool)
    expected[LATE] = expected[MISSED] = True
    assert np.array_equal(left_out, np.repeat(expected[:, None], 4, axis=1))


def test_what_all_ticks_are_late_by_is_no_reason_to_leave_any_out(recording: Recording) -> None:
    recording["sent_s"][:] += 3e-3
    assert np.flatnonzero(untimely(recording)).tolist() == [LATE, *range(100, 104)]


def test_readings_that_are_missing_are_held_for_who_is_steered_along_them(
    recording: Recording,
) -> None:
    record = record_of(recording, servo_actuator(Model()))
    assert np.isfinite(record.readings).all()
    assert np.array_equal(record.readings[MISSED, 0], np.full(4, recording["position_m"][99]))
    assert np.ptp(record.readings[:, 0]) < 0.01


def test_a_simulated_recording_has_no_untimely_samples(recording: Recording) -> None:
    timeless = {k: v for k, v in recording.channels.items() if k not in ("sent_s", "exchange_s")}
    assert not untimely(Recording(timeless)).any()


def test_a_reading_is_taken_back_to_the_time_that_its_row_tells(recording: Recording) -> None:
    rng = np.random.default_rng(0)
    late = 5e-5 * rng.standard_normal(N).clip(-2.0, 2.0)
    true = 0.1 + 0.3 * recording["time_s"]
    recording["exchange_s"][:] += late
    recording["position_m"][:] = true + 0.3 * late
    record = record_of(recording, servo_actuator(Model()))
    used = np.isfinite(record.variances[:, 0])
    used[:10] = used[-10:] = used[LATE - 10 : LATE + 10] = used[85:120] = False
    assert used.sum() > 0.5 * N
    # All are late by the usual: that is no error, and shifts them alike.
    off = (record.readings[:, 0] - true)[used]
    assert np.std(off) < 0.15 * np.std(0.3 * late)
