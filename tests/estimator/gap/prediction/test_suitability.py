"""Recordings that cannot support a verdict are told apart, with the reason, before any fit."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.gap.plant.interface import Trace
from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.held_out import channel_gaps
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.suitability import unsuitable, usable, worse_than_resting
from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.servo.proposals import propose_position_delay
from estimator.gap.verdict.workflow import find_gap
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from rig.recording import Recording
from tools.simulated.recordings import recorded_healthy

Array = NDArray[np.float64]
PLANT = servo_actuator(Model())
CHANNELS = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m")


@cache
def moved(seconds: float = 6.0, amplitude: float = 0.05) -> Recording:
    """A sine in closed loop of the nominal rig."""
    time_s = TICK * np.arange(round(seconds / TICK))
    recording = recorded_healthy(NOMINAL, 0.3 + amplitude * np.sin(3.0 * time_s), False, 1)
    return Recording({name: recording[name] for name in CHANNELS})


def changed(change: Callable[[dict[str, Array]], dict[str, Array]]) -> Recording:
    channels = {name: moved()[name].copy() for name in CHANNELS}
    return Recording(channels | change(channels))


def reasons_of(recording: Recording) -> list[str]:
    records = [record_of(recording, PLANT)]
    kept = usable(records, PLANT)
    with ThreadPoolExecutor(1) as pool:
        fitter = Fitter(Predictor(PLANT), kept, pool)
        return unsuitable(fitter, fitter)


def test_a_rig_without_a_spool_sensor_is_suitable_and_judged_by_the_others() -> None:
    blind = changed(lambda c: {"spool_m": np.full(len(c["spool_m"]), np.nan)})
    assert reasons_of(blind) == []
    (record,) = usable([record_of(blind, PLANT)], PLANT)
    with ThreadPoolExecutor(1) as pool:
        gaps = channel_gaps(Predictor(PLANT), [record], PLANT.nominal, PLANT.nominal, pool)
    assert [gap.channel for gap in gaps] == ["position_m", "pressure_1_Pa", "pressure_2_Pa"]
    assert all(gap.before == pytest.approx(gap.floor, rel=0.3) for gap in gaps)


@pytest.mark.parametrize("every", [2, 4])
def test_readings_of_some_samples_only_are_suitable(every: int) -> None:
    def seldom(c: dict[str, Array]) -> dict[str, Array]:
        kept = np.arange(len(c["spool_m"])) % every == 0
        return {name: np.where(kept, c[name], np.nan) for name in CHANNELS[2:]}

    record = record_of(changed(seldom), PLANT)
    assert np.isinf(record.variances[1::every]).all()
    assert usable([record], PLANT) == [record]
    assert reasons_of(changed(seldom)) == []


def noise(n: int, size: float) -> Array:
    return np.asarray(size * np.random.default_rng(3).standard_normal(n))


@pytest.mark.parametrize(("size", "told"), [(3e4, False), (1e6, True)])
def test_oil_that_swings_between_rare_readings_is_no_noise(size: float, told: bool) -> None:
    step, whole = np.arange(3000) * 5e-3, np.arange(15000)
    swing = np.exp(-11.6 * (step % 0.3)) * np.cos(232.0 * (step % 0.3))
    read = 7e6 + 1.5e6 * swing + noise(len(step), size)
    # Neighbours bend more than they move, as noise does.
    assert np.median(np.abs(np.diff(read, 2))) > np.median(np.abs(np.diff(read)))
    seldom = whole % 5 == 0
    channels: dict[str, Array] = {
        "time_s": np.asarray(TICK * whole, np.float64),
        "command_V": np.resize(moved()["command_V"], 15000),
    }
    for name in CHANNELS[2:]:
        channels[name] = np.where(seldom, np.resize(moved()[name], 15000), np.nan)
    channels["pressure_1_Pa"][seldom] = read
    reasons = reasons_of(Recording(channels))
    assert any("pressure_1_Pa is mostly noise" in reason for reason in reasons) is told, reasons


def test_a_ram_that_moves_is_suitable() -> None:
    assert reasons_of(moved()) == []


BAD: dict[str, tuple[Callable[[dict[str, Array]], dict[str, Array]], str]] = {
    "too short": (lambda c: {name: values[:2000] for name, values in c.items()}, "too short"),
    "no command": (lambda c: {"command_V": 0.0 * c["command_V"]}, "never changes"),
    "position in mm": (lambda c: {"position_m": 1e3 * c["position_m"]}, "position_m"),
    "pressure in bar": (lambda c: {"pressure_1_Pa": 1e-5 * c["pressure_1_Pa"]}, "pressure_1_Pa"),
    "pressure in psi": (lambda c: {"pressure_2_Pa": c["pressure_2_Pa"] / 6895}, "pressure_2_Pa"),
    "spool in mm": (lambda c: {"spool_m": 1e3 * c["spool_m"]}, "spool_m"),
    "a dead sensor": (lambda c: {"pressure_1_Pa": 0.0 * c["pressure_1_Pa"] + 5e6}, "hardly moves"),
    "a saturated sensor": (lambda c: {"pressure_2_Pa": 0.0 * c["pressure_2_Pa"]}, "end of its"),
    "all noise": (lambda c: {"pressure_1_Pa": 7e6 + noise(len(c["spool_m"]), 1e6)}, "noise"),
    "position all noise": (lambda c: {"position_m": 0.3 + noise(len(c["spool_m"]), 0.05)}, "noise"),
    "another rig's spool": (lambda c: {"spool_m": 2e-4 - c["spool_m"]}, "nothing to do"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_cannot_support_a_verdict_is_told_with_its_reason(name: str) -> None:
    change, words = BAD[name]
    told = reasons_of(changed(change))
    assert any(words in reason for reason in told), told


def test_a_ram_that_rests_cannot_support_a_verdict() -> None:
    told = reasons_of(moved(amplitude=0.0))
    assert any("hardly moves" in reason for reason in told), told


def test_an_unsuitable_recording_is_inconclusive_and_leaves_the_model_as_it_is() -> None:
    still = moved(amplitude=0.0)
    result = find_gap([still], [still], PLANT)
    assert result.verdict == "inconclusive"
    assert result.reasons
    assert result.effects == []
    assert result.values == dict(PLANT.nominal)


def test_swapped_pressures_are_predicted_worse_than_by_resting() -> None:
    swapped = changed(
        lambda c: {"pressure_1_Pa": c["pressure_2_Pa"], "pressure_2_Pa": c["pressure_1_Pa"]}
    )
    predictor = Predictor(PLANT)
    worse = []
    for recording in (swapped, moved()):
        record = record_of(recording, PLANT)
        gains = predictor.filter(record, PLANT.nominal)
        worse.append(worse_than_resting(predictor, record, gains, PLANT.nominal))
    assert {"pressure_1_Pa", "pressure_2_Pa"} <= set(worse[0])
    assert worse[1] == []


def parts_of(change: Callable[[dict[str, Array]], dict[str, Array]]) -> list[int]:
    return [len(part) for part in usable([record_of(changed(change), PLANT)], PLANT)]


def empty(*chambers: int, first: int, last: int) -> Callable[[dict[str, Array]], dict[str, Array]]:
    def emptied(c: dict[str, Array]) -> dict[str, Array]:
        read = {
            f"pressure_{chamber}_Pa": c[f"pressure_{chamber}_Pa"].copy() for chamber in chambers
        }
        for pressure in read.values():
            pressure[first:last] = 0.0
        return read

    return emptied


def test_a_rig_is_followed_anew_once_both_chambers_were_empty() -> None:
    before, after = parts_of(empty(1, 2, first=2000, last=2400))
    # The mean of some readings tells where a sensor is at its limit.
    assert 1980 < before <= 2000
    assert 3580 < after <= 3600
    # What is shorter than the filter's settling and a block is of no use.
    (after,) = parts_of(empty(1, 2, first=300, last=700))
    assert 5280 < after <= 5300


def test_one_empty_chamber_and_a_moment_without_readings_are_followed() -> None:
    assert parts_of(empty(2, first=2000, last=4000)) == [6000]
    assert parts_of(empty(1, 2, first=2000, last=2020)) == [6000]


def test_a_recording_that_cannot_be_followed_anywhere_is_told_of_as_a_whole() -> None:
    assert parts_of(empty(1, 2, first=0, last=6000)) == [6000]


@pytest.mark.long
def test_what_is_left_out_of_recordings_is_told() -> None:
    emptied = changed(empty(1, 2, first=2000, last=2400))
    # Which effects are looked for is nothing to this.
    few = replace(PLANT, effects={}, layout=None)
    (said,) = [r for r in find_gap([emptied], [moved()], few).reasons if "left out" in r]
    assert said.startswith("0.4 s of the recordings cannot be followed")


def test_a_recording_that_cannot_be_followed_is_left_out_beside_others() -> None:
    blind = record_of(changed(empty(1, 2, first=0, last=6000)), PLANT)
    good = record_of(moved(), PLANT)
    assert usable([blind, good], PLANT) == [good]
    assert usable([blind], PLANT) == [blind]


def test_a_channel_that_is_not_read_is_not_predicted_worse_than_by_resting() -> None:
    predictor = Predictor(PLANT)
    whole = record_of(changed(empty(1, first=300, last=6000)), PLANT)
    gains = predictor.filter(whole, PLANT.nominal)
    assert np.isinf(whole.variances[500:, 1]).all()
    assert worse_than_resting(predictor, whole, gains, PLANT.nominal) == []


def test_a_channel_that_one_part_lacks_has_the_gap_of_the_others() -> None:
    lacking = record_of(changed(empty(1, first=300, last=6000)), PLANT)
    good = record_of(moved(), PLANT)
    with ThreadPoolExecutor(1) as pool:
        predictor = Predictor(PLANT)
        of_both = channel_gaps(predictor, [lacking, good], PLANT.nominal, PLANT.nominal, pool)
        of_none = channel_gaps(predictor, [lacking], PLANT.nominal, PLANT.nominal, pool)
    assert all(np.isfinite([g.before, g.after, g.floor, g.scatter]).all() for g in of_both)
    assert np.isnan(of_none[1].before)
    assert np.isfinite(of_none[0].before)


def test_a_part_of_a_recording_knows_when_it_began() -> None:
    """A pump's ripple goes on while a rig cannot be followed."""
    values = {**PLANT.nominal, "supply_ripple": 6e5, "supply_ripple_frequency": 33.0}
    predictor = Predictor(PLANT)
    whole = predictor.twin(record_of(moved(), PLANT), values, 0)
    whole.variances[1500:1707, 1:3] = np.inf
    _, later = usable([whole], PLANT)
    assert later.first == 1707
    gains = predictor.filter(later, values)
    in_phase = predictor.innovations(later, gains, values)[0][500:, 1:3]
    assert np.var(in_phase) < 1.2
    off = predictor.innovations(replace(later, first=0), gains, values)[0][500:, 1:3]
    assert np.var(off) > 1.4 * np.var(in_phase)


def test_a_position_is_not_called_late_by_what_tells_nothing_of_the_oil() -> None:
    record = record_of(moved(), PLANT)
    nothing = np.zeros((len(record), 11)), np.zeros((len(record), 4))
    record.readings[:, 1:3] = 0.0
    trace = Trace(record.inputs, *nothing, record.readings)
    assert propose_position_delay([trace], PLANT.nominal) == ()
