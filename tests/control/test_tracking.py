"""What the tracking law sends to the valve: laws that hold whatever setpoint and position do."""

from math import nan
from typing import Final

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN, proportional_command
from control.tracking import (
    PLAIN,
    PROPORTIONAL,
    TONE_NUMBERS,
    ControlLaw,
    ControlMemory,
    begin_motion,
    control_memory,
    tracking_command,
)
from rig.plant.integrator import TICK

LAW: Final = ControlLaw(False, 0.05, 0.3, 0.3, 50.0, 1.0, 5e-4, 3.0)
TONES: Final = np.array([[np.pi, 1e-3, 2e-4, 0.01]])
NONE: Final = np.empty((0, TONE_NUMBERS))
positions = st.floats(0.0, 0.6)
volts = st.floats(-COMMAND_LIMIT, COMMAND_LIMIT)


def command(
    setpoint: float,
    position: float,
    memory: ControlMemory,
    law: ControlLaw = LAW,
    ahead: float = 0.0,
    time_s: float = 0.0,
    tones: np.ndarray = NONE,
    expected: float | None = None,
) -> float:
    goes_by = setpoint if expected is None else expected
    return float(
        tracking_command(
            setpoint, position, ahead, goes_by, time_s, POSITION_GAIN, COMMAND_LIMIT, TICK, law,
            tones, memory,
        )
    )  # fmt: skip


@given(positions, positions)
def test_the_proportional_law_is_gain_times_error_bit_for_bit(a: float, b: float) -> None:
    plain = proportional_command(a, b, POSITION_GAIN, COMMAND_LIMIT)
    assert command(a, b, control_memory(), PROPORTIONAL) == plain
    assert command(a, b, control_memory(), PLAIN.law) == plain


@settings(max_examples=50)
@given(st.lists(st.tuples(positions, positions, volts), min_size=1, max_size=60))
def test_command_integral_and_correction_stay_within_their_limits(
    ticks: list[tuple[float, float, float]],
) -> None:
    memory, fast = control_memory(), np.array([[np.pi, 3.0, -5.0, 0.01]])
    for k, (setpoint, position, ahead) in enumerate(ticks):
        sent = command(setpoint, position, memory, ahead=ahead, time_s=k * TICK, tones=fast)
        assert abs(sent) <= COMMAND_LIMIT
        assert abs(memory.kept[0]) <= LAW.integral_limit_V
        assert np.hypot(*memory.learnt[0]) <= 0.01 * (1.0 + 1e-12)


@pytest.mark.parametrize(
    ("setpoint", "position", "ahead", "expected"),
    [(nan, 0.3, 0.0, 0.3), (0.3, nan, 0.0, 0.3), (0.3, 0.3, nan, 0.3), (0.3, 0.3, 0.0, nan)],
)
def test_what_is_not_known_nulls_the_valve_and_empties_the_integral(
    setpoint: float, position: float, ahead: float, expected: float
) -> None:
    memory = control_memory()
    memory.kept[0] = 0.7
    assert command(setpoint, position, memory, ahead=ahead, expected=expected) == 0.0
    assert memory.kept[0] == 0.0


def test_a_ram_without_error_gets_null_and_feedforward() -> None:
    law = LAW._replace(deadband_V=0.0)
    assert command(0.3, 0.3, control_memory(), law, ahead=2.0) == pytest.approx(2.05)


def test_the_deadband_is_bridged_without_a_jump_at_null() -> None:
    errors = np.linspace(-2e-2, 2e-2, 2001)
    sent = np.array([command(0.3 + e, 0.3, control_memory()) for e in errors])
    slope = np.diff(sent) / np.diff(errors) / POSITION_GAIN
    assert slope.min() >= 1.0 - 1e-9
    assert slope.max() <= 1.0 + LAW.deadband_V / LAW.width_V + 1e-9
    far = POSITION_GAIN * errors[-1]
    assert sent[-1] == pytest.approx(LAW.null_V + far + LAW.deadband_V, rel=0.05)


def test_the_integral_grows_while_the_setpoint_moves_but_not_in_the_band_of_a_hold() -> None:
    memory = control_memory()
    for k in range(100):
        command(0.3 + 1e-5 * k, 0.3 + 1e-5 * k - 2e-4, memory)
    grown = memory.kept[0]
    assert grown > 0.0
    for _ in range(100):
        command(0.4, 0.4 - 2e-4, memory)
    # The first of these ticks is a move of the setpoint.
    assert memory.kept[0] == pytest.approx(grown, abs=2.0 * LAW.integral_rate * 2e-4 * TICK)


def test_outside_the_band_the_integral_of_a_hold_grows_until_the_setpoint_has_rested() -> None:
    memory, law = control_memory(), LAW._replace(rest_s=0.05)
    command(0.3, 0.299, memory, law)
    found = []
    for _ in range(100):
        command(0.3, 0.299, memory, law)
        found.append(memory.kept[0])
    assert found[40] > found[0] > 0.0
    assert found[-1] == found[60]


def test_a_command_at_its_limit_winds_nothing_up() -> None:
    memory = control_memory()
    for k in range(100):
        command(0.6, 0.1 + 1e-5 * k, memory, tones=TONES)
    assert memory.kept[0] == 0.0
    assert not memory.learnt.any()


def test_the_next_motion_keeps_the_integral_and_forgets_the_corrections() -> None:
    memory = control_memory()
    for k in range(10):
        command(0.3 + 1e-4 * k, 0.3, memory, tones=TONES)
    before = memory.kept[0]
    begin_motion(True, memory)
    assert memory.kept[0] == before > 0.0
    assert not memory.learnt.any()
    begin_motion(False, memory)
    assert memory.kept[0] == 0.0


def test_a_tone_is_learnt_until_the_error_at_its_frequency_is_gone() -> None:
    # A ram that lags: a plain integrator of 0.07 m/(s V), of which the loop knows nothing.
    law, gain, speed = LAW._replace(null_V=0.0, deadband_V=0.0, integral_rate=0.0), 50.0, 0.07
    omega = np.pi
    answer = speed * gain / (1j * omega + speed * gain)
    factor = 2.0 * TICK / 4.0 / answer
    tones = np.array([[omega, factor.real, factor.imag, 0.5]])
    memory, position, errors = control_memory(), 0.3, []
    for k in range(40_000):
        setpoint = 0.3 + 0.05 * np.sin(omega * k * TICK)
        errors.append(setpoint - position)
        sent = command(setpoint, position, memory, law, time_s=k * TICK, tones=tones)
        position += speed * sent * TICK
    assert np.abs(errors[-2000:]).max() < 0.02 * np.abs(errors[:4000]).max()


def test_the_integral_goes_by_the_expected_position_and_not_by_the_setpoint() -> None:
    memory = control_memory()
    for k in range(100):
        command(0.3 + 1e-5 * k, 0.3, memory, expected=0.3)
    assert memory.kept[0] == 0.0
    for k in range(100):
        command(0.3 + 1e-5 * k, 0.3, memory, expected=0.299)
    assert memory.kept[0] < 0.0
