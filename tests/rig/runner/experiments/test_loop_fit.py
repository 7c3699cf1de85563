"""The linear model of a sliding ram is found from what it does."""

from math import pi
from typing import Final

import numpy as np
import pytest

from rig.plant.integrator import TICK
from rig.runner.experiments.loop_fit import fitted_loop

FREQUENCIES: Final = (1.0, 2.0, 3.0, 5.0, 8.0)


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
