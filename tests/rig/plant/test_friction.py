"""The ram sticks, creeps, breaks away and slides as its friction law says."""

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from scipy.optimize import brentq

from rig.plant import BRISTLE, KARNOPP, NOMINAL, Model, Parameters
from rig.plant.dynamics import friction, slip_friction, valve_conductance
from rig.plant.integrator import TICK
from rig.plant.simulation import simulate

LAWS = st.sampled_from([BRISTLE, KARNOPP])
EACH_LAW = pytest.mark.parametrize("law", [BRISTLE, KARNOPP], ids=["bristle", "karnopp"])
EACH_DIRECTION = pytest.mark.parametrize("direction", [1.0, -1.0], ids=["out", "in"])
SHUT = np.zeros(200)


def pushed(
    law: float, force: float, asymmetry: float = 0.0, position: float = 0.3
) -> dict[str, np.ndarray]:
    """Run a ram at rest, valve shut, pushed by `force` (N) that its bristles bear if they can."""
    rig = NOMINAL._replace(friction_law=law, friction_asymmetry=asymmetry)
    half = 0.5 * force / rig.piston_area
    borne = float(np.clip(force, -rig.stiction, rig.stiction)) if law == BRISTLE else 0.0
    bent = borne / rig.bristle_stiffness
    start = [0.0, 0.0, 6.9e6 + half, 6.9e6 - half, position, 0.0, bent, 13.8e6, 0.0]
    return simulate(Model(parameters=rig), SHUT, initial=start)


@given(st.floats(-0.999, 0.999), st.floats(0.01, 0.6), st.floats(-500.0, 500.0))
def test_below_the_stiction_force_a_karnopp_ram_does_not_move_at_all(
    fraction: float, position: float, asymmetry: float
) -> None:
    held = NOMINAL.stiction + np.sign(fraction) * asymmetry
    run = pushed(KARNOPP, fraction * held, asymmetry, position)
    assert (run["velocity"] == 0.0).all()
    assert (run["position"] == position).all()


@given(st.floats(-0.999, 0.999), st.floats(0.01, 0.6))
def test_below_the_stiction_force_bent_bristles_hold_the_ram(
    fraction: float, position: float
) -> None:
    run = pushed(BRISTLE, fraction * NOMINAL.stiction, position=position)
    assert np.abs(run["position"] - position).max() < 1e-9


def loaded_slowly(law: float, direction: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (force in N, way in m) of a ram whose hardly open valve loads it ever more."""
    rig = NOMINAL._replace(friction_law=law)
    run = simulate(Model(parameters=rig), np.full(3000, 0.01 * direction), position=0.3)
    force = rig.piston_area * (run["pressure_1"] - run["pressure_2"])
    return direction * force, direction * (run["position"] - 0.3)


@EACH_DIRECTION
def test_under_a_growing_force_a_karnopp_ram_stands_still_up_to_the_stiction_force(
    direction: float,
) -> None:
    force, moved = loaded_slowly(KARNOPP, direction)
    gone = int(np.argmax(moved != 0.0))
    assert force[gone - 1] == pytest.approx(NOMINAL.stiction, rel=0.01)
    assert moved[-1] > 5e-4


@EACH_DIRECTION
def test_under_a_growing_force_a_bristle_ram_creeps_by_microns_as_its_bristles_yield(
    direction: float,
) -> None:
    force, moved = loaded_slowly(BRISTLE, direction)
    scale = NOMINAL.stiction / NOMINAL.bristle_stiffness
    for load in (0.25, 0.5, 0.75):
        reached = int(np.argmax(force > load * NOMINAL.stiction))
        # dz/dt = v (1 - s_0 z / g) for creeping one way from rest, F = s_0 z.
        assert moved[reached] == pytest.approx(-scale * np.log(1.0 - load), rel=0.05)
    assert force.max() == pytest.approx(NOMINAL.stiction, rel=0.03)
    assert moved[-1] > 5e-4


@EACH_LAW
@EACH_DIRECTION
def test_above_the_stiction_force_the_ram_breaks_away_towards_it(
    law: float, direction: float
) -> None:
    stuck = pushed(law, 0.99 * direction * NOMINAL.stiction)
    loose = pushed(law, 1.2 * direction * NOMINAL.stiction)
    assert stuck["position"][-1] == pytest.approx(0.3, abs=1e-9)
    assert direction * (loose["position"][-1] - 0.3) > 3e-4


@EACH_DIRECTION
def test_asymmetry_lets_the_karnopp_ram_go_earlier_one_way(direction: float) -> None:
    force = 1.05 * direction * NOMINAL.stiction
    assert pushed(KARNOPP, force, 200.0 * direction)["velocity"].any() == np.False_
    assert pushed(KARNOPP, force, -200.0 * direction)["velocity"].any()


@EACH_LAW
def test_a_ram_thrown_against_its_friction_stops_and_stays(law: float) -> None:
    rig = NOMINAL._replace(friction_law=law)
    start = np.array([0.0, 0.0, 6.9e6, 6.9e6, 0.3, 0.3, 0.0, 13.8e6, 0.0])
    run = simulate(Model(parameters=rig), SHUT, initial=start)
    assert run["position"].max() > 0.3
    resting = 0.0 if law == KARNOPP else 1e-6
    assert np.abs(run["velocity"][-50:]).max() <= resting
    pushing = rig.piston_area * (run["pressure_1"][-1] - run["pressure_2"][-1])
    assert abs(pushing) < rig.stiction


def terminal_velocity(rig: Parameters, command: float) -> float:
    """Return the speed in m/s at which both valve edges, friction and pressures are in balance."""
    opening = rig.valve_gain * command + rig.spool_null_bias
    direction = np.sign(opening)
    passed = valve_conductance(rig) * abs(opening)

    def surplus(speed: float) -> float:
        edge_drop = (rig.piston_area * speed / passed) ** 2
        driving = rig.supply_pressure - rig.return_pressure - 2.0 * edge_drop
        level = rig.coulomb + (rig.stiction - rig.coulomb) * np.exp(-speed / rig.stribeck_velocity)
        level += direction * rig.friction_asymmetry
        return float(rig.piston_area * driving - level - rig.viscous * speed)

    return float(direction * brentq(surplus, 0.2, 3.0))


@given(
    law=LAWS,
    command=st.one_of(st.floats(-10.0, -5.0), st.floats(5.0, 10.0)),
    asymmetry=st.floats(-300.0, 300.0),
    bias=st.floats(-1e-5, 1e-5),
    back=st.floats(0.0, 1e6),
    supply=st.floats(1e7, 2e7),
)
def test_the_ram_reaches_its_terminal_velocity(
    law: float, command: float, asymmetry: float, bias: float, back: float, supply: float
) -> None:
    rig = NOMINAL._replace(
        friction_law=law,
        friction_asymmetry=asymmetry,
        spool_null_bias=bias,
        return_pressure=back,
        supply_pressure=supply,
    )
    expected = terminal_velocity(rig, command)
    time = 0.45 / abs(expected)
    assume(time > 0.35)
    run = simulate(
        Model(parameters=rig),
        np.full(int(time / TICK), command),
        position=0.05 if command > 0.0 else 0.55,
    )
    assert run["velocity"][-1] == pytest.approx(expected, rel=1e-3)


@EACH_LAW
@given(speed=st.floats(1e-3, 1.0), direction=st.sampled_from([-1.0, 1.0]))
def test_at_constant_speed_both_laws_give_the_same_friction(
    law: float, speed: float, direction: float
) -> None:
    rig = NOMINAL._replace(friction_law=law, friction_asymmetry=100.0)
    level = slip_friction(speed, direction, rig)
    state = direction if law == KARNOPP else direction * level / rig.bristle_stiffness
    rate, force = friction(direction * speed, state, rig)
    printed = rig.coulomb + (rig.stiction - rig.coulomb) * np.exp(-speed / rig.stribeck_velocity)
    expected = direction * (printed + rig.viscous * speed) + rig.friction_asymmetry
    assert force == pytest.approx(expected, rel=1e-9)
    assert rate == pytest.approx(0.0, abs=1e-12)
