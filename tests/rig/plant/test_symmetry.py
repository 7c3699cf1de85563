"""The rig seen in a mirror is the same rig with its chambers exchanged."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.plant import KARNOPP, NOMINAL, FaultInput, Model, Parameters
from rig.plant.dynamics import PlantState
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TICKS = 40
LEAKS = st.floats(0.0, 2e-8)
LINEAR_LEAKS = st.floats(0.0, 5e-12)


@st.composite
def rigs(draw: st.DrawFn) -> Parameters:
    return NOMINAL._replace(
        friction_law=draw(st.sampled_from([0.0, KARNOPP])),
        line_volume_1=draw(st.floats(1e-5, 5e-5)),
        line_volume_2=draw(st.floats(1e-5, 5e-5)),
        entrained_air=draw(st.sampled_from([0.0, 0.005])),
        friction_asymmetry=draw(st.floats(-300.0, 300.0)),
        spool_null_bias=draw(st.floats(-2e-5, 2e-5)),
        valve_deadband=draw(st.sampled_from([0.0, 1e-5])),
        valve_underlap_leakage=draw(st.sampled_from([0.0, 5e-6])),
        valve_flow_asymmetry=draw(st.sampled_from([0.0, 0.2])),
        valve_hysteresis=draw(st.sampled_from([0.0, 5e-6])),
        valve_rate_limit=draw(st.sampled_from([1e3, 0.02])),
        command_delay=draw(st.sampled_from([0.0, 0.0024])),
        constant_force=draw(st.floats(-2e3, 2e3)),
        payload_mass=draw(st.sampled_from([0.0, 100.0])),
        stop_low=draw(st.sampled_from([-0.1, 0.05])),
        stop_high=draw(st.sampled_from([5.0, 0.5])),
        external_leakage_1=draw(LEAKS),
        external_leakage_2=draw(LEAKS),
        internal_leakage=draw(LEAKS),
        external_leakage_1_linear=draw(LINEAR_LEAKS),
        external_leakage_2_linear=draw(LINEAR_LEAKS),
        internal_leakage_linear=draw(LINEAR_LEAKS),
        supply_leakage=draw(LEAKS),
        supply_droop=draw(st.sampled_from([0.0, 5e12])),
        return_back_pressure=draw(st.sampled_from([0.0, 5e12])),
        return_pressure=draw(st.sampled_from([0.0, 3e5])),
    )


def mirrored_rig(rig: Parameters) -> Parameters:
    """Return the rig in the mirror: 1 - a of port 2 is that of port 1, which C_d takes on."""
    second = 1.0 - rig.valve_flow_asymmetry
    return rig._replace(
        discharge_coefficient=rig.discharge_coefficient * second,
        valve_flow_asymmetry=1.0 - 1.0 / second,
        constant_force=-rig.constant_force,
        stop_low=rig.stroke_min + rig.stroke_max - rig.stop_high,
        stop_high=rig.stroke_min + rig.stroke_max - rig.stop_low,
        line_volume_1=rig.line_volume_2,
        line_volume_2=rig.line_volume_1,
        friction_asymmetry=-rig.friction_asymmetry,
        spool_null_bias=-rig.spool_null_bias,
        external_leakage_1=rig.external_leakage_2,
        external_leakage_2=rig.external_leakage_1,
        external_leakage_1_linear=rig.external_leakage_2_linear,
        external_leakage_2_linear=rig.external_leakage_1_linear,
    )


def mirrored(run: dict[str, Array], rig: Parameters) -> dict[str, Array]:
    opposite = ("spool", "spool_velocity", "velocity", "friction_state")
    image = {name: -run[name] if name in opposite else run[name] for name in run}
    image["position"] = rig.stroke_min + rig.stroke_max - run["position"]
    image["pressure_1"], image["pressure_2"] = run["pressure_2"], run["pressure_1"]
    return image


@given(
    rig=rigs(),
    command=st.lists(st.floats(-10.0, 10.0), min_size=4, max_size=4),
    position=st.floats(0.001, 0.606),
    leak=LEAKS,
)
def test_exchanging_the_chambers_mirrors_the_run(
    rig: Parameters, command: list[float], position: float, leak: float
) -> None:
    # A ram inside a stop would be shot out of it.
    position = min(max(position, rig.stop_low + 1e-3), rig.stop_high - 1e-3)
    voltage = np.repeat(command, TICKS // 4)
    fault = np.array([FaultInput(leak, 0.0, 0.5 * leak, 0.0, 0.0, 0.0, leak, 1e12)])
    swapped = fault[:, [1, 0, 2, 4, 3, 5, 6, 7]]
    run = simulate(Model(parameters=rig), voltage, position=position, faults=fault)
    image = simulate(
        Model(parameters=mirrored_rig(rig)),
        -voltage,
        position=rig.stroke_min + rig.stroke_max - position,
        faults=swapped,
    )
    expected = mirrored(run, rig)
    # Rounding only, grown by stick-slip; a tenth of a pascal and of a nanometre.
    scale = PlantState(1e-10, 1e-7, 0.1, 0.1, 1e-10, 1e-7, 1e-10, 0.1, 0.1)._asdict()
    for name, tolerance in scale.items():
        assert image[name] == pytest.approx(expected[name], rel=1e-9, abs=tolerance), name
