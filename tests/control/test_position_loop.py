"""What the proportional position loop sends to the valve."""

from math import inf, nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN, proportional_command

positions = st.floats(-1.0, 1.0)


@given(positions, positions)
def test_the_command_never_exceeds_its_limit(setpoint: float, position: float) -> None:
    command = proportional_command(setpoint, position, POSITION_GAIN, COMMAND_LIMIT)
    assert abs(command) <= COMMAND_LIMIT


@given(positions, positions)
def test_within_the_limit_the_command_is_proportional_to_the_error(
    setpoint: float, position: float
) -> None:
    command = proportional_command(setpoint, position, POSITION_GAIN, COMMAND_LIMIT)
    error = setpoint - position
    if abs(error) < COMMAND_LIMIT / POSITION_GAIN:
        assert command == POSITION_GAIN * error
    else:
        assert command == pytest.approx(np.copysign(COMMAND_LIMIT, error))


def test_the_rigs_loop_saturates_at_20_cm() -> None:
    assert proportional_command(0.3, 0.2, POSITION_GAIN, COMMAND_LIMIT) == pytest.approx(5.0)
    assert proportional_command(0.5, 0.1, POSITION_GAIN, COMMAND_LIMIT) == 10.0
    assert proportional_command(0.1, 0.5, POSITION_GAIN, COMMAND_LIMIT) == -10.0


@pytest.mark.parametrize(("setpoint", "position"), [(0.3, nan), (nan, 0.3), (nan, nan), (inf, inf)])
def test_the_valve_is_nulled_when_position_or_setpoint_is_unknown(
    setpoint: float, position: float
) -> None:
    assert proportional_command(setpoint, position, POSITION_GAIN, COMMAND_LIMIT) == 0.0


@given(positions, positions)
def test_exchanging_setpoint_and_position_reverses_the_command(a: float, b: float) -> None:
    there = proportional_command(a, b, POSITION_GAIN, COMMAND_LIMIT)
    back = proportional_command(b, a, POSITION_GAIN, COMMAND_LIMIT)
    assert there == -back


def test_the_compiled_loop_computes_what_python_does() -> None:
    for setpoint, position in np.random.default_rng(1).uniform(-0.1, 0.7, (200, 2)):
        compiled = proportional_command(setpoint, position, POSITION_GAIN, COMMAND_LIMIT)
        plain = proportional_command.py_func(setpoint, position, POSITION_GAIN, COMMAND_LIMIT)
        assert compiled == plain
