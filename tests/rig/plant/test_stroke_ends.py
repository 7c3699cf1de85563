"""The ram stops at its stroke ends and leans on a spring; neither gives back more than it took."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.plant import BRISTLE, KARNOPP, NOMINAL, Model
from rig.plant.dynamics import environment_force
from rig.plant.simulation import simulate

LAWS = st.sampled_from([BRISTLE, KARNOPP])


@given(LAWS, st.sampled_from([-10.0, 10.0]))
def test_a_stroke_end_holds_the_ram_at_full_command(law: float, command: float) -> None:
    rig = NOMINAL._replace(friction_law=law)
    run = simulate(Model(parameters=rig), np.full(1200, command), position=0.3)
    end = rig.stroke_max if command > 0.0 else rig.stroke_min
    past = np.sign(command) * (run["position"] - end)
    # Supply pressure on the piston presses it 0.15 mm into the end; the impact, five times that.
    static = rig.piston_area * rig.supply_pressure / rig.stop_stiffness
    assert past.max() < 5.0 * static
    assert 0.0 < past[-1] <= 1.001 * static
    assert np.abs(run["velocity"][-300:]).max() < 1e-3


@given(speed=st.floats(0.05, 1.0), law=LAWS, outwards=st.booleans())
def test_a_ram_thrown_against_a_stroke_end_comes_back_slower(
    speed: float, law: float, outwards: bool
) -> None:
    # Neither oil nor friction nor viscosity: what is lost is lost in the contact.
    rig = NOMINAL._replace(
        friction_law=law, stiction=0.0, coulomb=0.0, viscous=0.0, bristle_damping=0.0,
        bulk_modulus=5e7, line_volume_1=1e-3, line_volume_2=1e-3,
    )  # fmt: skip
    direction = 1.0 if outwards else -1.0
    end = rig.stroke_max if outwards else rig.stroke_min
    start = np.array([0.0, 0.0, 0.0, 0.0, end - direction * 1e-3, direction * speed, 0.0, 1e6, 0.0])
    run = simulate(Model(parameters=rig), np.zeros(int(0.002 / speed / 1e-3) + 6), initial=start)
    velocity = direction * run["velocity"]
    assert velocity.min() < 0.0
    assert -velocity.min() < 0.98 * speed


@given(st.floats(0.0, 0.6069), st.floats(-1.0, 1.0))
def test_within_the_stroke_there_is_no_force_from_its_ends(
    position: float, velocity: float
) -> None:
    assert environment_force(position, velocity, NOMINAL) == 0.0


@given(st.floats(1e-6, 1e-3), st.floats(-1.0, 1.0))
def test_a_stroke_end_pushes_and_never_pulls(depth: float, velocity: float) -> None:
    assert environment_force(NOMINAL.stroke_max + depth, velocity, NOMINAL) >= 0.0
    assert environment_force(NOMINAL.stroke_min - depth, velocity, NOMINAL) <= 0.0


@given(
    stiffness=st.sampled_from([2e4, 6e5]),
    contact=st.floats(0.1, 0.5),
    position=st.floats(0.0, 0.6),
    velocity=st.floats(-1.0, 1.0),
)
def test_a_spring_pushes_back_from_its_contact_on(
    stiffness: float, contact: float, position: float, velocity: float
) -> None:
    rig = NOMINAL._replace(spring_stiffness=stiffness, spring_contact=contact)
    expected = stiffness * max(0.0, position - contact)
    assert environment_force(position, velocity, rig) == pytest.approx(expected, rel=1e-12)


def test_a_stiff_spring_stalls_the_ram_where_force_and_friction_balance_the_supply() -> None:
    # The thesis's stiff spring takes 8.7 kN of the piston in 14 mm (ERRATA on section 7.2.1).
    rig = NOMINAL._replace(spring_stiffness=6e5, spring_contact=0.22, friction_law=KARNOPP)
    run = simulate(Model(parameters=rig), np.full(1000, 5.0), position=0.2)
    load = environment_force(run["position"][-1], 0.0, rig)
    pushing = rig.piston_area * rig.supply_pressure
    assert run["velocity"][-1] == pytest.approx(0.0, abs=1e-3)
    assert pushing - rig.stiction <= load <= pushing + rig.stiction
    assert load == pytest.approx(rig.spring_stiffness * (run["position"][-1] - 0.22))
    assert run["pressure_1"][-1] == pytest.approx(rig.supply_pressure, rel=0.01)
