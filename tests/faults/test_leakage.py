"""The leakage laws against the thesis's own figures."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, strategies as st

from faults.leakage import linear_flow, square_root_flow, to_litres_per_minute
from rig.plant.dynamics import leak_flows
from rig.plant.faults import NO_FAULT
from rig.plant.parameters import LITRE_PER_MINUTE, NOMINAL
from tools.thesis_tables.laws import linear_coefficient, square_root_coefficient

LAWS = [
    pytest.param(square_root_flow, square_root_coefficient, id="square root"),
    pytest.param(linear_flow, linear_coefficient, id="linear"),
]

drops = st.floats(1e2, 2e7) | st.floats(-2e7, -1e2)
coefficients = st.floats(1e-12, 1e-6)


def test_the_factor_of_eq_5_3_is_one_litre_per_minute() -> None:
    assert pytest.approx(1.67e-5, rel=3e-3) == LITRE_PER_MINUTE
    assert to_litres_per_minute(1e-3) == pytest.approx(60.0)


def test_the_low_leak_of_section_5_1_1_passes_the_same_by_both_laws() -> None:
    # Mean coefficients of one recording, so their flows agree at its mean pressure only: 5.9 MPa.
    drop = (3.87e-9 / 1.59e-12) ** 2
    assert drop == pytest.approx(5.9e6, rel=0.01)
    square_root = to_litres_per_minute(square_root_flow(3.87e-9, drop))
    assert square_root == pytest.approx(0.565, rel=0.01)
    assert to_litres_per_minute(linear_flow(1.59e-12, drop)) == pytest.approx(square_root)


def test_the_coefficient_of_section_7_2_1_passes_four_times_the_leak_it_is_quoted_for() -> None:
    flow = to_litres_per_minute(square_root_flow(7.65e-9, 6.9e6))
    assert flow == pytest.approx(1.2, rel=0.01)
    assert flow > 3.5 * 0.32


@pytest.mark.parametrize(("flow", "coefficient"), LAWS)
@given(k=coefficients, drop=drops)
def test_a_measured_flow_gives_its_coefficient_back(
    flow: Callable[..., float], coefficient: Callable[..., float], k: float, drop: float
) -> None:
    assert coefficient(flow(k, drop), drop) == pytest.approx(k, rel=1e-12)


@pytest.mark.parametrize(("flow", "coefficient"), LAWS)
@given(k=coefficients, drop=drops)
def test_oil_leaks_down_the_pressure_drop(
    flow: Callable[..., float], coefficient: Callable[..., float], k: float, drop: float
) -> None:
    assert np.sign(flow(k, drop)) == np.sign(drop)
    assert flow(k, -drop) == -flow(k, drop)


def test_without_a_pressure_drop_nothing_leaks_and_nothing_is_learnt() -> None:
    drop = np.array([0.0, 4e6])
    flow = square_root_flow(1e-9, drop)
    assert flow.tolist() == pytest.approx([0.0, 2e-6])
    np.testing.assert_allclose(square_root_coefficient(flow, drop), [np.nan, 1e-9])
    assert np.isnan(linear_coefficient(0.0, 0.0))


@given(p1=st.floats(1e5, 1.3e7), p2=st.floats(1e5, 1.3e7), k=coefficients)
def test_the_plant_leaks_by_the_same_laws(p1: float, p2: float, k: float) -> None:
    square_root = NO_FAULT._replace(external_leakage_1=k, internal_leakage=k)
    q1, q2, q12 = leak_flows(p1, p2, 0.0, NOMINAL, np.array(square_root))
    assert (q1, q2) == (pytest.approx(square_root_flow(k, p1)), 0.0)
    assert q12 == pytest.approx(square_root_flow(k, p1 - p2))
    linear = NO_FAULT._replace(external_leakage_2_linear=k, internal_leakage_linear=k)
    q1, q2, q12 = leak_flows(p1, p2, 0.0, NOMINAL, np.array(linear))
    assert (q1, q2) == (0.0, pytest.approx(linear_flow(k, p2)))
    assert q12 == pytest.approx(linear_flow(k, p1 - p2))
