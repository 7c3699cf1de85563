"""A curve that was discovered is an effect of the rig if it runs as the effect does."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from estimator.gap.plant.interface import Array
from estimator.gap.servo.effects import EFFECTS

OPENINGS = np.array([-2e-4, -9e-5, -6e-5, -3e-5, -1e-5, 1e-5, 3e-5, 6e-5, 9e-5])
SPEEDS = np.linspace(-0.4, 0.3, 9)


def read(effect: str, at: Array, values: Array) -> float | None:
    (like,) = EFFECTS[effect].like
    return like.read(at, values)


@given(st.floats(5e-6, 5e-5))
def test_edges_that_are_open_near_the_null_alone_are_an_underlap(underlap: float) -> None:
    curve = underlap * np.exp(-np.abs(OPENINGS) / 2.5e-5)
    found = read("valve_underlap_leakage", OPENINGS, curve)
    assert found == pytest.approx(underlap * np.exp(-0.4))


@pytest.mark.parametrize(
    "curve",
    [
        -2e-5 * np.exp(-np.abs(OPENINGS) / 2.5e-5),
        np.full(9, 2e-5),
        1e-6 + 2e-5 * np.abs(OPENINGS) / 2e-4,
        2e-5 * np.exp(-np.square((OPENINGS + 2e-4) / 5e-5)),
    ],
    ids=["shut near the null", "open everywhere", "more open far out", "open on one side"],
)
def test_edges_that_differ_otherwise_are_no_underlap(curve: Array) -> None:
    assert read("valve_underlap_leakage", OPENINGS, curve) is None


@given(st.floats(-500.0, 500.0).filter(lambda size: abs(size) > 1.0))
def test_a_force_that_is_the_same_in_both_directions_is_uneven_friction(size: float) -> None:
    """It adds to the friction of extension and takes away from that of retraction."""
    found = read("friction_asymmetry", SPEEDS, size * np.abs(SPEEDS) / 0.3)
    assert found is not None
    assert np.sign(found) == np.sign(size)
    assert abs(found) < abs(size)


def test_drag_is_not_uneven_friction() -> None:
    assert read("friction_asymmetry", SPEEDS, 800.0 * SPEEDS * np.abs(SPEEDS)) is None
    assert read("friction_asymmetry", SPEEDS[5:], 800.0 * SPEEDS[5:]) is None


@given(st.floats(-0.08, 0.08).filter(lambda part: abs(part) > 1e-3))
def test_an_error_in_proportion_to_the_reading_is_a_scale(part: float) -> None:
    at = np.linspace(-0.2, 0.25, 9)
    assert read("position_gain", at, part * at) == pytest.approx(1.0 + part)
    assert read("position_gain", at, part * np.sin(2.0 * np.pi * at / 0.1)) is None


def test_what_is_read_off_a_curve_is_a_value_of_the_effects_first_knob() -> None:
    known = [effect for effect in EFFECTS.values() if effect.like]
    assert len(known) == 5
    assert all(len(effect.knobs) == 1 for effect in known)
