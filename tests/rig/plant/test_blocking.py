"""Blocking valves throttle the servovalve as orifices in series do."""

from math import sqrt

import pytest

from rig.plant import NOMINAL, OPEN_CONDUCTANCE, leak_conductance, throttled
from rig.plant.dynamics import valve_conductance

OPENING = 8e-6


def test_open_valves_change_nothing() -> None:
    assert throttled(NOMINAL, OPENING, (OPEN_CONDUCTANCE, OPEN_CONDUCTANCE)) is NOMINAL


def test_a_shut_valve_passes_what_two_orifices_in_series_pass() -> None:
    shut = leak_conductance(1.7e-9, 1e7)
    par = throttled(NOMINAL, OPENING, (shut, OPEN_CONDUCTANCE))
    edge = valve_conductance(NOMINAL) * OPENING
    series = 1.0 / sqrt(shut**-2 + edge**-2)
    assert valve_conductance(par) * OPENING == pytest.approx(series)
    # The other port, whose valve is open, passes what it passed before.
    second = 1.0 - par.valve_flow_asymmetry
    assert second * valve_conductance(par) * OPENING == pytest.approx(edge)
