"""Flows, leaks and lines settle where their closed forms say; pressures stay within bounds."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.plant import KARNOPP, NO_FAULT, NOMINAL, FaultInput, Model, Parameters
from rig.plant.dynamics import leak_flows, signed_root, valve_conductance, valve_flows
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

PRESSURES = st.floats(0.0, 2e7)

CHATTER = 0.1 * DATA_SHEET.pressure_noise
"""Pa. Where no oil moves, the root is infinitely steep and the integrator chatters this much."""


def settled(
    rig: Parameters, command: float, position: float, fault: FaultInput = NO_FAULT
) -> dict[str, float]:
    """Return the state of a rig after half a second of constant command, by name."""
    run = simulate(
        Model(parameters=rig),
        np.full(500, command),
        position=position,
        faults=np.array([fault]),
    )
    return {name: float(values[-1]) for name, values in run.items()}


def test_the_valve_passes_what_its_data_sheet_says() -> None:
    # Section 2.1: 34 L/min at 20.7 MPa; the valve drops it across two edges in series.
    full = NOMINAL.valve_gain * 10.0
    through, _ = valve_flows(
        full, 20.7e6 / 2.0, 20.7e6 / 2.0, 20.7e6, 0.0, valve_conductance(NOMINAL)
    )
    assert through / LITRE_PER_MINUTE == pytest.approx(32.6, abs=0.1)


@given(st.floats(1e-6, 3e-4), PRESSURES, PRESSURES, st.floats(0.0, 1e6))
def test_flow_runs_down_the_pressure_drop(
    opening: float, p1: float, p2: float, back: float
) -> None:
    supply = 13.8e6
    q1, q2 = valve_flows(opening, p1, p2, supply, back, valve_conductance(NOMINAL))
    assert q1 * (supply - p1) >= 0.0
    assert q2 * (p2 - back) >= 0.0
    q1, q2 = valve_flows(-opening, p1, p2, supply, back, valve_conductance(NOMINAL))
    assert q1 * (p1 - back) <= 0.0
    assert q2 * (supply - p2) <= 0.0


@given(PRESSURES, PRESSURES, st.floats(0.0, 1e6))
def test_a_leak_follows_the_root_or_the_drop_and_takes_its_sign(
    p1: float, p2: float, back: float
) -> None:
    turbulent = NO_FAULT._replace(
        external_leakage_1=1e-9, external_leakage_2=2e-9, internal_leakage=3e-9
    )
    laminar = NO_FAULT._replace(
        external_leakage_1_linear=1e-12, external_leakage_2_linear=2e-12,
        internal_leakage_linear=3e-12,
    )  # fmt: skip
    drops = np.array([p1 - back, p2 - back, p1 - p2])
    roots = np.sign(drops) * np.sqrt(np.abs(drops))
    coefficients = np.array([1.0, 2.0, 3.0])
    bent = leak_flows(p1, p2, back, NOMINAL, turbulent)
    straight = leak_flows(p1, p2, back, NOMINAL, laminar)
    assert bent == pytest.approx(1e-9 * coefficients * roots, rel=1e-12)
    assert straight == pytest.approx(1e-12 * coefficients * drops, rel=1e-12)


def test_a_leak_of_the_model_and_an_injected_one_are_two_paths_in_parallel() -> None:
    coefficients = NO_FAULT._replace(
        external_leakage_1=1e-9, external_leakage_2=2e-9, internal_leakage=3e-9,
        external_leakage_1_linear=1e-12, external_leakage_2_linear=2e-12,
        internal_leakage_linear=3e-12,
    )  # fmt: skip
    own = {
        name: value for name, value in coefficients._asdict().items() if name in Parameters._fields
    }
    leaking = NOMINAL._replace(**own)
    one = leak_flows(9e6, 4e6, 1e5, NOMINAL, coefficients)
    assert one == leak_flows(9e6, 4e6, 1e5, leaking, NO_FAULT)
    assert leak_flows(9e6, 4e6, 1e5, leaking, coefficients) == pytest.approx(
        2.0 * np.array(one), rel=1e-12
    )


@given(st.floats(-1e8, 1e8))
def test_the_signed_root_squares_back(drop: float) -> None:
    root = signed_root(drop)
    assert root * abs(root) == pytest.approx(drop, rel=1e-12)


@given(
    droop=st.floats(0.0, 2e13),
    back=st.floats(0.0, 5e12),
    leak=st.floats(1e-9, 3e-8),
    command=st.floats(2.0, 10.0),
    blockage=st.floats(0.0, 5e12),
)
def test_supply_and_return_settle_at_their_line_losses(
    droop: float, back: float, leak: float, command: float, blockage: float
) -> None:
    """A ram that a spring has stalled lets the supply through chamber 1 and its leak to return."""
    rig = NOMINAL._replace(
        supply_droop=droop, return_back_pressure=back, external_leakage_1=leak,
        return_pressure=2e5, spring_stiffness=5e6, spring_contact=0.3,
    )  # fmt: skip
    end = settled(rig, command, 0.3, NO_FAULT._replace(return_blockage=blockage))
    edge = valve_conductance(rig) * rig.valve_gain * command
    resistance = droop + 1.0 / edge**2 + 1.0 / leak**2 + back + blockage
    flow = np.sqrt((rig.supply_pressure - rig.return_pressure) / resistance)
    supply = rig.supply_pressure - droop * flow**2
    returned = rig.return_pressure + (back + blockage) * flow**2
    assert end["supply_pressure"] == pytest.approx(supply, abs=CHATTER)
    assert end["return_pressure"] == pytest.approx(returned, abs=CHATTER)
    assert end["pressure_1"] == pytest.approx(supply - (flow / edge) ** 2, abs=CHATTER)
    assert end["pressure_2"] == pytest.approx(returned, abs=CHATTER)


@given(st.floats(2.0, 10.0), st.sampled_from([1.0, -1.0]))
def test_a_shut_chamber_behind_a_wide_open_edge_does_not_chatter_visibly(
    command: float, direction: float
) -> None:
    end = NOMINAL.stroke_max if direction > 0.0 else NOMINAL.stroke_min
    run = simulate(Model(), np.full(300, direction * command), position=end - direction * 1e-3)
    pressed, emptied = ("pressure_1", "pressure_2")[:: int(direction)]
    assert np.abs(run[pressed][200:] - NOMINAL.supply_pressure).max() < CHATTER
    assert np.abs(run[emptied][200:]).max() < CHATTER


@given(st.floats(1e-9, 2e-7), st.floats(1e11, 2e13), st.floats(0.0, 2e13))
def test_a_supply_leak_lowers_the_supply_and_raises_the_return_behind_a_blockage(
    leak: float, droop: float, blockage: float
) -> None:
    rig = NOMINAL._replace(supply_droop=droop, return_pressure=2e5)
    fault = NO_FAULT._replace(supply_leakage=leak, return_blockage=blockage)
    end = settled(rig, 0.0, 0.3, fault)
    span = rig.supply_pressure - rig.return_pressure
    flow = np.sqrt(span / (1.0 / leak**2 + droop + blockage))
    assert end["supply_pressure"] == pytest.approx(rig.supply_pressure - droop * flow**2, rel=1e-6)
    assert end["return_pressure"] == pytest.approx(
        rig.return_pressure + blockage * flow**2, rel=1e-6, abs=1.0
    )


def test_a_blocked_return_line_is_the_back_pressure_of_a_fault() -> None:
    command = 5.0 * np.sin(np.arange(500) * 0.01)
    built_in = simulate(Model(parameters=NOMINAL._replace(return_back_pressure=1e13)), command)
    injected = simulate(
        Model(), command, faults=np.array([NO_FAULT._replace(return_blockage=1e13)])
    )
    assert built_in["return_pressure"].max() > 1e5
    for name, values in built_in.items():
        assert (values == injected[name]).all()


@given(
    law=st.sampled_from([0.0, KARNOPP]),
    commands=st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6),
    position=st.floats(0.0, 0.6069),
    leak=st.floats(0.0, 1e-8),
    droop=st.sampled_from([0.0, 5e12]),
)
def test_pressures_stay_between_an_empty_chamber_and_supply_plus_shock(
    law: float, commands: list[float], position: float, leak: float, droop: float
) -> None:
    rig = NOMINAL._replace(
        friction_law=law, internal_leakage=leak, external_leakage_2=leak, supply_droop=droop
    )
    run = simulate(Model(parameters=rig), np.repeat(commands, 60), position=position)
    # The ram's momentum stopped by the smallest chamber: A dp = v sqrt(m k), k = A^2 beta / V.
    fastest = np.abs(run["velocity"]).max()
    shock = fastest * np.sqrt(rig.moving_mass * rig.bulk_modulus / rig.line_volume_1)
    for name in ("pressure_1", "pressure_2"):
        assert run[name].max() <= rig.supply_pressure + shock + 1e4
        assert run[name].min() > -rig.bulk_modulus  # a cavity is smaller than its chamber
    assert run["supply_pressure"].max() <= rig.supply_pressure + 1e4
    assert run["supply_pressure"].min() > 0.0
    assert (np.abs(run["spool"]) <= 1.1 * 10.0 * rig.valve_gain).all()
