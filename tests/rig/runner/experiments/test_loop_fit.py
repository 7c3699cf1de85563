"""The linear model of a sliding ram is found from what it does, and its margins are the loop's."""

from math import degrees, pi
from typing import Final

import numpy as np
import pytest

from control import ControlSettings
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.runner.experiments.loop_fit import LoopModel, fitted_loop, margins

FREQUENCIES: Final = (1.0, 2.0, 3.0, 5.0, 8.0)
SLIDING: Final = LoopModel(0.3, True, 0.067, 2e-3, 0.0, 0.75, 0.05)


def test_speed_for_a_volt_and_lag_of_an_integrator_are_found() -> None:
    time_s = np.arange(4000) * TICK
    command = 0.8 + sum(0.04 * np.cos(2.0 * pi * f * time_s + f) for f in FREQUENCIES)
    late = time_s - 5e-3
    position = 0.1 + 0.066 * (
        0.8 * time_s
        + sum(0.04 * np.sin(2.0 * pi * f * late + f) / (2.0 * pi * f) for f in FREQUENCIES)
    )
    counted = np.round(position / 3e-5) * 3e-5
    found = fitted_loop(counted, command, FREQUENCIES, True)
    assert found.speed_per_volt == pytest.approx(0.066, rel=0.01)
    assert found.lag_s == pytest.approx(5e-3, abs=1e-3)
    assert found.misfit < 0.02
    assert found.speed == pytest.approx(0.8 * 0.066, rel=0.01)
    assert found.mean_V == pytest.approx(0.8, abs=1e-3)


def test_an_integrator_with_a_lag_has_the_margins_of_the_textbook() -> None:
    stiff = NOMINAL._replace(moving_mass=1.0, bulk_modulus=2.5e9)
    found = margins(SLIDING, ControlSettings(), 1000.0, stiff, 8e-3)
    # Integrator and delay of 10 ms: -180 degrees at a quarter turn per delay.
    assert found.crossover == pytest.approx(67.0, rel=0.02)
    assert degrees(found.phase) == pytest.approx(90.0 - degrees(67.0 * 0.01), abs=1.0)
    assert found.gain_dB == pytest.approx(20.0 * np.log10(0.5 * pi / 0.01 / 67.0), abs=0.2)
    assert not margins(SLIDING, ControlSettings(), 2000.0, stiff, 8e-3).kept


def test_a_lag_an_integral_and_a_bridged_deadband_all_cost_margin() -> None:
    plain = margins(SLIDING, ControlSettings(), 50.0, NOMINAL, 0.0)
    slower = margins(SLIDING, ControlSettings(), 50.0, NOMINAL, 0.01)
    integral = margins(SLIDING, ControlSettings(integral_time=1.0), 50.0, NOMINAL, 0.0)
    bridged = margins(SLIDING, ControlSettings(deadband=0.3), 50.0, NOMINAL, 0.0)
    assert plain.kept
    assert slower.phase < plain.phase
    assert integral.phase < plain.phase - 0.1
    assert bridged.gain_dB == pytest.approx(plain.gain_dB - 6.02, abs=0.1)


def test_the_oil_s_resonance_bounds_the_gain() -> None:
    soft = NOMINAL._replace(bulk_modulus=1e8, moving_mass=100.0)
    assert margins(SLIDING, ControlSettings(), 300.0, NOMINAL, 0.0).kept
    assert not margins(SLIDING, ControlSettings(), 300.0, soft, 0.0).kept
