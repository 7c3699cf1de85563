"""Waves of straight lines, and setpoints one after the other."""

from math import inf, pi

import numpy as np
import pytest

from control.setpoints import (
    Constant,
    Multisine,
    Sequence,
    SetpointError,
    Sine,
    Steps,
    Stretch,
    Trapezoid,
    Triangle,
    period_of,
)

TICKS = 1e-3 * np.arange(20_001)


def test_a_triangle_has_the_phase_of_a_sine_and_a_constant_speed() -> None:
    triangle = Triangle(0.3, 0.1, 0.5)
    values = triangle.sample(np.array([0.0, 0.5, 1.0, 1.5, 2.0]))
    assert values.tolist() == pytest.approx([0.3, 0.4, 0.3, 0.2, 0.3])
    speeds = np.abs(np.diff(triangle.sample(TICKS))) / 1e-3
    assert triangle.peak_rate(20.0) == pytest.approx(0.2)
    assert speeds.max() <= 0.2 + 1e-9
    assert Triangle(0.3, 0.1, 0.5, 0.5 * pi).sample(np.zeros(1))[0] == pytest.approx(0.4)


def test_a_trapezoid_rests_at_both_ends_and_keeps_its_period() -> None:
    wave = Trapezoid(0.3, 0.1, 0.25, 1.0)
    values = wave.sample(TICKS)
    assert (values.min(), values.max()) == pytest.approx((0.2, 0.4))
    at_the_top = np.count_nonzero(np.isclose(values[:4000], 0.4)) * 1e-3
    assert at_the_top == pytest.approx(1.0, abs=2e-3)
    assert values[4000:8000] == pytest.approx(values[:4000], abs=1e-9)
    assert np.abs(np.diff(values)).max() / 1e-3 == pytest.approx(wave.peak_rate(20.0))


def test_a_trapezoid_without_time_to_move_is_refused() -> None:
    with pytest.raises(SetpointError, match="leaves no time to move"):
        Trapezoid(0.3, 0.1, 0.5, 1.0)


@pytest.mark.parametrize(
    ("setpoint", "period"),
    [
        (Sine(0.3, 0.1, 0.5), 2.0),
        (Triangle(0.3, 0.1, 4.0), 0.25),
        (Trapezoid(0.3, 0.1, 0.25, 1.0), 4.0),
        (Multisine(0.3, 0.1, (0.5, 0.75)), 4.0),
        (Constant(0.3), None),
    ],
)
def test_setpoints_that_repeat_themselves_say_after_which_time(
    setpoint: Sine, period: float | None
) -> None:
    assert period_of(setpoint) == (None if period is None else pytest.approx(period))


def sequence() -> Sequence:
    return Sequence(
        (
            Stretch(Sine(0.3, 0.1, 0.5), 4.0, "cycling"),
            Stretch(Constant(0.3), 2.0, "rest"),
            Stretch(Steps((0.4, 0.2), 2.0), 4.0, "steps", blend_s=1.0),
        )
    )


def test_a_sequence_is_each_setpoint_with_a_time_of_its_own() -> None:
    whole = sequence()
    values = whole.sample(TICKS)
    assert values[:4000].tolist() == Sine(0.3, 0.1, 0.5).sample(TICKS[:4000]).tolist()
    assert set(values[4000:6000].tolist()) == {0.3}
    assert values[6500] == pytest.approx(0.35)
    assert set(values[7000:9000].tolist()) == {0.4}
    assert set(values[9000:11_000].tolist()) == {0.2}
    assert (whole.duration_s, whole.starts_s) == (11.0, (0.0, 4.0, 6.0))
    assert whole.window_s("steps") == (7.0, 11.0)
    assert whole.window_s("other") is None


def test_a_sequence_moves_as_fast_as_its_fastest_part_up_to_then() -> None:
    assert sequence().peak_rate(5.0) == pytest.approx(0.1 * pi)
    assert sequence().peak_rate(11.0) == inf
    blended = Sequence((Stretch(Constant(0.2), 1.0), Stretch(Constant(0.4), 1.0, blend_s=1.0)))
    assert blended.peak_rate(3.0) == pytest.approx(0.1 * pi)
    assert np.abs(np.diff(blended.sample(TICKS))).max() / 1e-3 <= 0.1 * pi + 1e-9


def test_a_setpoint_that_jumps_where_two_meet_is_refused_with_the_jump() -> None:
    with pytest.raises(SetpointError, match=r"begins \+0.1 m from where the one before ends"):
        Sequence((Stretch(Constant(0.2), 1.0), Stretch(Constant(0.3), 1.0)))


def test_what_both_move_in_a_tick_is_no_jump() -> None:
    # 0.9995 s of a sine of 0.5 Hz end half a tick before its mean.
    early = Stretch(Sine(0.3, 0.1, 0.5), 1.9995)
    assert Sequence((early, Stretch(Constant(0.3), 1.0))).duration_s == pytest.approx(2.9995)


def test_metres_and_volts_are_not_mixed() -> None:
    mixed = Stretch(Constant(0.0), 1.0), Stretch(Constant(0.0, "command"), 1.0)
    with pytest.raises(SetpointError, match="another quantity"):
        Sequence(mixed)
