"""Friction is recovered from recordings of rigs whose friction is known."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, strategies as st

from estimator.friction.curve import (
    FrictionCurve,
    friction_changes,
    identify_friction,
    identify_recording,
    slip_curve,
)
from estimator.friction.fit import NO_FIT, PARAMETERS, fit_stribeck
from estimator.friction.samples import (
    BlockCollector,
    FrictionSamples,
    LoadLag,
    MotionBlocks,
    Spring,
    friction_samples,
    load_lag,
)
from estimator.leaks.replaying import filter_recording, part_of, samples_of, stretch
from rig.plant import NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET
from rig.recording import Recording
from tools.simulated.recordings import recorded_healthy

NO_SPRING = Spring(0.0, 0.0)
WORN = NOMINAL._replace(
    stiction=2000.0, coulomb=900.0, viscous=450.0, friction_asymmetry=-80.0, bulk_modulus=6.2e8
)


@cache
def sine_of(rig: Parameters, seconds: float = 20.0, amplitude: float = 0.2) -> Recording:
    time_s = TICK * np.arange(round(seconds / TICK))
    return recorded_healthy(rig, 0.3 + amplitude * np.sin(np.pi * time_s), False, 1)


def found(recording: Recording, spring: Spring = NO_SPRING) -> FrictionCurve:
    return identify_recording(recording, Model(), spring)


def off(curve: FrictionCurve, rig: Parameters, name: str) -> float:
    """Return a parameter's error in standard errors."""
    estimate = curve.estimates[name]
    assert estimate.value is not None
    assert estimate.standard_error is not None
    return (estimate.value - float(getattr(rig, name))) / estimate.standard_error


@pytest.mark.parametrize("rig", [NOMINAL, WORN], ids=["nominal", "worn"])
def test_friction_that_was_simulated_is_found_within_its_interval(rig: Parameters) -> None:
    curve = found(sine_of(rig))
    for name in PARAMETERS:
        assert abs(off(curve, rig, name)) < 3.0, name
    assert curve.estimates["stiction"].value == pytest.approx(rig.stiction, rel=0.1)
    assert curve.estimates["coulomb"].value == pytest.approx(rig.coulomb, rel=0.01)


def test_a_known_spring_leaves_the_same_friction() -> None:
    spring = Spring(2e4, 0.22)
    rig = NOMINAL._replace(spring_stiffness=spring.stiffness, spring_contact=spring.contact)
    curve = found(sine_of(rig), spring)
    assert all(abs(off(curve, rig, name)) < 3.0 for name in PARAMETERS)


def test_a_spring_that_nobody_knows_of_is_no_friction() -> None:
    rig = NOMINAL._replace(spring_stiffness=2e4, spring_contact=0.22)
    curve = found(sine_of(rig))
    assert not any(estimate.identified for estimate in curve.estimates.values())
    assert "--spring" in curve.estimates["coulomb"].needs


def test_a_motion_without_steady_sliding_shows_nothing_and_says_what_would() -> None:
    curve = found(sine_of(NOMINAL, 5.0, 0.002))
    assert curve.fit is NO_FIT
    assert not curve.drawable
    assert all("sine" in estimate.needs for estimate in curve.estimates.values())


def test_pressures_that_are_swapped_are_no_friction() -> None:
    recording = sine_of(NOMINAL)
    channels = dict(recording.channels)
    names = "pressure_1_Pa", "pressure_2_Pa"
    channels |= dict(zip(names, (channels[name] for name in reversed(names)), strict=True))
    curve = found(Recording(channels))
    for estimate in curve.estimates.values():
        assert (estimate.identified, estimate.value) == (False, None)
        assert "pressure_1_Pa and pressure_2_Pa are swapped" in estimate.needs


@pytest.mark.long
def test_worn_seals_differ_and_the_same_rig_does_not() -> None:
    new, worn = found(sine_of(NOMINAL)), found(sine_of(WORN))
    changed = {change.name for change in friction_changes(new, worn) if change.significant}
    assert {"coulomb", "viscous", "friction_asymmetry"} <= changed
    again = recorded_healthy(NOMINAL, sine_of(NOMINAL)["setpoint_m"], False, 2)
    assert not any(change.significant for change in friction_changes(new, found(again)))


def test_the_medians_lie_on_the_fitted_curve() -> None:
    curve = found(sine_of(NOMINAL))
    velocity = np.array([each.velocity for each in curve.bins])
    force = np.array([each.force for each in curve.bins])
    assert np.all(np.diff(velocity) > 0.0)
    assert force == pytest.approx(curve.force(velocity), abs=15.0)


def test_blocks_do_not_depend_on_how_a_recording_arrives() -> None:
    recording = sine_of(NOMINAL)
    samples, run = samples_of(recording), filter_recording(recording, Model())
    whole, pieces = BlockCollector(NOMINAL), BlockCollector(NOMINAL)
    whole.take(samples, run)
    for start, end in ((0, 501), (501, 508), (508, 6000), (6000, None)):
        part = slice(start, end)
        pieces.take(stretch(samples, part), part_of(run, part))
    for name in MotionBlocks.__dataclass_fields__:
        one, other = getattr(whole.blocks, name), getattr(pieces.blocks, name)
        assert np.array_equal(one, other, equal_nan=one.dtype == float)


def test_what_no_sensor_measured_counts_for_nothing() -> None:
    recording = sine_of(NOMINAL)
    gaps = {name: values.copy() for name, values in recording.channels.items()}
    gaps["pressure_1_Pa"][5000:9000] = np.nan
    gaps["position_m"][12000:12005] = np.nan
    curve = found(Recording(gaps))
    assert all(abs(off(curve, NOMINAL, name)) < 3.5 for name in PARAMETERS)


def test_the_filter_lags_by_about_a_millisecond() -> None:
    lag = load_lag(Model(), DATA_SHEET)
    assert 0.5e-3 < lag.load_s < 3e-3
    # The oil column hides nothing of the motion: 10 N/ms shift the velocity by a millimetre/s.
    assert abs(lag.velocity * 1e4) < 1e-3


def test_strokes_in_one_direction_show_no_asymmetry() -> None:
    samples = ideal((1100.0, 2400.0, 0.04, 350.0, 0.0), ways=(1.0,))
    fit = fit_stribeck(samples)
    assert np.isnan(fit.values[4])
    assert fit.values[:4] == pytest.approx([1100.0, 2400.0, 0.04, 350.0], rel=0.05)


def test_an_outlier_in_twenty_does_not_move_the_curve() -> None:
    samples = ideal((1100.0, 2400.0, 0.04, 350.0, 60.0))
    force = samples.force.copy()
    force[::20] += 2000.0
    fit = fit_stribeck(replace(samples, force=force))
    assert fit.values == pytest.approx([1100.0, 2400.0, 0.04, 350.0, 60.0], rel=0.05)


@given(
    coulomb=st.floats(300.0, 3000.0),
    falls=st.floats(0.5, 1.5),
    alpha=st.floats(0.02, 0.08),
    viscous=st.floats(50.0, 1000.0),
    asymmetry=st.floats(-300.0, 300.0),
)
def test_any_friction_is_found_from_clean_samples(
    coulomb: float, falls: float, alpha: float, viscous: float, asymmetry: float
) -> None:
    values = (coulomb, coulomb * (1.0 + falls), alpha, viscous, asymmetry)
    fit = fit_stribeck(ideal(values, noise=0.0))
    assert fit.values == pytest.approx(values, rel=1e-2, abs=1.0)


@given(data=st.data(), count=st.integers(0, 40))
def test_no_motion_makes_a_nan_where_a_number_is_claimed(data: st.DataObject, count: int) -> None:
    columns = [
        np.array(data.draw(st.lists(st.floats(-bound, bound), min_size=count, max_size=count)))
        for bound in (1.0, 0.1, 5e3, 0.6)
    ]
    velocity, spread, load, position = columns
    blocks = MotionBlocks(
        np.linspace(0.0, 0.01 * count, count),
        velocity,
        np.abs(spread),
        load,
        position,
        np.ones(count, bool),
    )
    curve = identify_friction(blocks, LoadLag(1e-3, 0.0), NO_SPRING, NOMINAL)
    for estimate in curve.estimates.values():
        assert estimate.identified != bool(estimate.needs)
        assert estimate.value is None or np.isfinite(estimate.value)


def test_nothing_is_taken_near_the_ends_of_the_stroke() -> None:
    count = 400
    blocks = MotionBlocks(
        np.linspace(0.0, 4.0, count), np.full(count, 0.2), np.zeros(count), np.full(count, 1e3),
        np.linspace(-0.1, 0.7, count), np.ones(count, dtype=bool),
    )  # fmt: skip
    kept = friction_samples(blocks, LoadLag(0.0, 0.0), NO_SPRING, NOMINAL)
    inside = (blocks.position > 0.005) & (blocks.position < 0.6019) & (blocks.time_s >= 1.0)
    assert 0 < kept.velocity.size <= int(inside.sum())


def ideal(
    values: tuple[float, float, float, float, float],
    ways: tuple[float, ...] = (-1.0, 1.0),
    noise: float = 5.0,
) -> FrictionSamples:
    """Return 16 strokes that slow down from 0.5 m/s to 15 mm/s."""
    rng = np.random.default_rng(3)
    strokes = 16
    speed = np.tile(np.geomspace(0.5, 0.015, 60), strokes)
    stroke = np.repeat(np.arange(strokes), 60)
    velocity = speed * np.array(ways)[stroke % len(ways)]
    force = slip_curve(velocity, values) + noise * rng.standard_normal(velocity.size)
    acceleration = rng.standard_normal(velocity.size)
    return FrictionSamples(velocity, force, acceleration, np.zeros_like(force), stroke)
