"""The margins of a sliding ram's loop are the textbook's, and the oil bounds its gain."""

from dataclasses import replace
from math import degrees, pi
from typing import Final

import numpy as np
import pytest

from control.settings import ControlSettings
from control.stability import LoopModel, least_margins, margins
from rig.plant import NOMINAL

SLIDING: Final = LoopModel(0.3, True, 0.067, 2e-3, 0.0, 0.75, 0.05)


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


def test_the_model_alone_gives_the_margins_of_the_place_that_has_least() -> None:
    settings, places = ControlSettings(integral_time=0.5), (0.1, 0.3, 0.5)
    found = least_margins(settings, 80.0, NOMINAL, 1e-3, places)
    single = [least_margins(settings, 80.0, NOMINAL, 1e-3, (at,)) for at in places]
    assert found.gain_dB == min(each.gain_dB for each in single)
    assert found.phase == min(each.phase for each in single)
    assert found.kept
    assert not least_margins(
        replace(settings, integral_time=0.05), 80.0, NOMINAL, 1e-3, places
    ).kept
