"""The equations of the thesis filters: Jacobians against complex steps, units, the plant."""

import importlib.util
from types import ModuleType
from typing import Any

import numba
import numpy as np
import pint
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from estimator.filters import thesis_model
from rig.plant import KARNOPP, NO_FAULT, NOMINAL, Parameters, quantities
from rig.plant.dynamics import rates
from tools.thesis_linearised import (
    ENTRIES,
    thesis6_jacobian,
    thesis6_predict,
    thesis7_jacobian,
    thesis7_predict,
)

Array = NDArray[np.float64]

COMPLEX_STEP = 1e-30
DIRECTIONS = {"extending": 1.0, "retracting": -1.0}
REGIMES = ("sliding", "stuck", "breaking away")
BREAKAWAY = NOMINAL.stiction / NOMINAL.piston_area
STATE_UNITS = ("m", "Pa", "Pa", "m", "m/s", "m/s", "N")


def uncompiled() -> ModuleType:
    """Return the model's module as plain Python, for numbers that numba does not know."""
    name, file = "thesis_model_uncompiled", thesis_model.__file__
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(numba.config, "DISABLE_JIT", True)
        spec.loader.exec_module(module)
    return module


PLAIN = uncompiled()


def predicted(size: int, state: Any, parameters: Any, u: Any = 2.0) -> tuple[Any, ...]:
    step = PLAIN.linearised_6 if size == 6 else PLAIN.linearised_7
    return tuple(step(tuple(state), u, parameters)[0])


def complex_step_jacobian(size: int, state: Array) -> Array:
    """Differentiate the prediction exactly; friction as printed does not know the pressures."""
    columns = []
    for column in range(size):
        shifted = state.astype(complex)
        shifted[column] += 1j * COMPLEX_STEP
        moved = np.array([complex(value) for value in predicted(size, shifted, NOMINAL)])
        if size == 6 and column in (1, 2):
            force = NOMINAL.piston_area * (shifted[1] - shifted[2])
            resistance = complex(PLAIN.friction(shifted[4], force, NOMINAL)[0])
            moved[4] += 1e-3 / NOMINAL.moving_mass * resistance
        columns.append(moved.imag / COMPLEX_STEP)
    return np.array(columns).T


def analytic_jacobian(size: int, state: Array) -> Array:
    return (thesis6_jacobian if size == 6 else thesis7_jacobian)(state, NOMINAL)


def agree(analytic: Array, numeric: Array) -> bool:
    return bool(np.all(np.abs(analytic - numeric) <= 1e-10 * np.abs(numeric)))


@st.composite
def states(draw: st.DrawFn, direction: str, regime: str) -> Array:
    """Draw a state (7,) within the rig's physical bounds."""
    spool = DIRECTIONS[direction] * draw(st.floats(1e-6, 2.8e-4))
    mean = draw(st.floats(5e6, 8e6))
    if regime == "breaking away":
        half = 0.5 * draw(st.floats(1.01, 2.0)) * BREAKAWAY
    else:
        half = 0.5 * draw(st.floats(0.0, 0.99)) * BREAKAWAY
    half *= draw(st.sampled_from([-1.0, 1.0]))
    speed = draw(st.floats(1.1e-3, 1.0) if regime == "sliding" else st.floats(0.0, 0.9e-3))
    velocity = speed * draw(st.sampled_from([-1.0, 1.0]))
    position = draw(st.floats(0.0, 0.6069))
    spool_velocity = draw(st.floats(-0.1, 0.1))
    load = draw(st.floats(-5e3, 5e3))
    return np.array([spool, mean + half, mean - half, position, velocity, spool_velocity, load])


GENERIC = {
    (direction, regime): np.array(
        [sign * 1.1e-4, 7.1e6 - drop / 2, 7.1e6 + drop / 2, 0.21, velocity, 0.02, 900.0]
    )
    for direction, sign in DIRECTIONS.items()
    for regime, drop, velocity in (
        ("sliding", 2e6, -0.07),
        ("stuck", 3e6, 6e-4),
        ("breaking away", 4.5e6, -3e-4),
    )
}


@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("regime", REGIMES)
@given(data=st.data())
def test_the_jacobian_is_the_derivative_of_the_prediction(
    size: int, direction: str, regime: str, data: st.DataObject
) -> None:
    state = data.draw(states(direction, regime))[:size]
    assert agree(analytic_jacobian(size, state), complex_step_jacobian(size, state))


@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize(("direction", "regime"), GENERIC)
def test_one_percent_in_any_entry_is_noticed(size: int, direction: str, regime: str) -> None:
    state = GENERIC[direction, regime][:size]
    numeric = complex_step_jacobian(size, state)
    sound = analytic_jacobian(size, state)
    assert agree(sound, numeric)
    broken_entries = np.argwhere(sound != np.eye(size))
    # A stuck ram's row 5 has a one where a44 stands while it slides.
    assert len(broken_entries) == (14 if size == 6 and regime != "sliding" else 15)
    for row, column in broken_entries:
        broken = sound.copy()
        broken[row, column] *= 1.01
        assert not agree(broken, numeric), (row, column)


@pytest.mark.parametrize("regime", ["sliding", "stuck"])
def test_the_uncompiled_model_is_the_compiled_one(regime: str) -> None:
    state = GENERIC["extending", regime]
    np.testing.assert_allclose(
        predicted(6, state[:6], NOMINAL), thesis6_predict(state[:6], 2.0, NOMINAL), rtol=1e-15
    )
    np.testing.assert_allclose(
        predicted(7, state, NOMINAL), thesis7_predict(state, 2.0, NOMINAL), rtol=1e-15
    )


@pytest.mark.parametrize("direction", DIRECTIONS)
@given(data=st.data())
def test_a_sliding_ram_is_predicted_by_one_euler_step_of_the_plant(
    direction: str, data: st.DataObject
) -> None:
    state = data.draw(states(direction, "sliding"))
    x_sp, p1, p2, x_a, v, v_sp, _ = state
    karnopp = NOMINAL._replace(friction_law=KARNOPP, return_pressure=3e5, stroke_min=-0.02)
    supply, back = karnopp.supply_pressure, karnopp.return_pressure
    sliding = np.sign(v)
    plant = np.array(
        rates(x_sp, v_sp, p1, p2, x_a, v, sliding, supply, back, 2.0, karnopp, NO_FAULT)
    )
    derivative = plant[[0, 2, 3, 4, 5, 1]]
    increment = thesis6_predict(state[:6], 2.0, karnopp) - state[:6]
    resolution = np.spacing(np.abs(state[:6])) * 4
    assert np.all(np.abs(increment - 1e-3 * derivative) <= resolution + 1e-9 * np.abs(increment))


def test_a_load_equal_to_friction_makes_the_two_predictions_equal() -> None:
    state = GENERIC["extending", "sliding"].copy()
    force = NOMINAL.piston_area * (state[1] - state[2])
    state[6] = thesis_model.friction(state[4], force, NOMINAL)[0]
    six, seven = thesis6_predict(state[:6], 2.0, NOMINAL), thesis7_predict(state, 2.0, NOMINAL)
    np.testing.assert_array_equal(six, seven[:6])
    assert seven[6] == state[6]


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_stiction_holds_against_a_force_from_either_side(direction: float) -> None:
    below, above = 0.99 * NOMINAL.stiction, 1.5 * NOMINAL.stiction
    assert thesis_model.friction(0.0, direction * below, NOMINAL)[0] == direction * below
    broken_away = thesis_model.friction(0.0, direction * above, NOMINAL)[0]
    assert broken_away == direction * NOMINAL.stiction


@given(speed=st.floats(1.1e-3, 1.0), force=st.floats(-5e3, 5e3))
def test_friction_of_a_sliding_ram_opposes_it_alike_in_both_directions(
    speed: float, force: float
) -> None:
    forward, slope = thesis_model.friction(speed, force, NOMINAL)
    backward, same_slope = thesis_model.friction(-speed, force, NOMINAL)
    assert forward > 0.0
    assert (backward, same_slope) == (-forward, slope)


@given(spool=st.floats(-3e-4, 3e-4), p1=st.floats(-5e7, 5e7), p2=st.floats(-5e7, 5e7))
def test_estimated_pressures_beyond_supply_and_return_have_a_finite_prediction(
    spool: float, p1: float, p2: float
) -> None:
    state = np.array([spool, p1, p2, 0.3, 0.1, 0.0])
    assert np.all(np.isfinite(thesis6_predict(state, 2.0, NOMINAL)))
    assert np.all(np.isfinite(thesis6_jacobian(state, NOMINAL)))


@pytest.fixture(scope="module")
def units() -> pint.UnitRegistry[Any]:
    return pint.UnitRegistry()


@pytest.fixture
def timed(units: pint.UnitRegistry[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(PLAIN, "TICK", units.Quantity(1e-3, "s"))
    monkeypatch.setattr(PLAIN, "PRESSURE_DROP_FLOOR", units.Quantity(1.0, "Pa"))


def measured_in(
    units: pint.UnitRegistry[Any], values: Any, names: tuple[str, ...]
) -> tuple[Any, ...]:
    return tuple(
        units.Quantity(float(value), name) for value, name in zip(values, names, strict=True)
    )


def parameters_with_units(units: pint.UnitRegistry[Any]) -> Any:
    names = tuple(quantity.unit for quantity in quantities().values())
    return Parameters(*measured_in(units, NOMINAL[: len(names)], names))


def check_units(units: pint.UnitRegistry[Any], size: int, state: Array, parameters: Any) -> None:
    """Carry units through the prediction and its Jacobian; raise where they do not fit."""
    step = PLAIN.linearised_6 if size == 6 else PLAIN.linearised_7
    symbols = STATE_UNITS[:size]
    start = measured_in(units, state[:size], symbols)
    moved, entries = step(start, units.Quantity(2.0, "V"), parameters)
    for before, after, unit in zip(start, moved, symbols, strict=True):
        (after - before).to(unit)
    for (row, column), entry in zip(ENTRIES[size], entries, strict=True):
        entry.to(units.Unit(symbols[row]) / units.Unit(symbols[column]))


@pytest.mark.usefixtures("timed")
@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize(("direction", "regime"), GENERIC)
def test_every_equation_and_jacobian_entry_has_its_unit(
    units: pint.UnitRegistry[Any], size: int, direction: str, regime: str
) -> None:
    check_units(units, size, GENERIC[direction, regime], parameters_with_units(units))


@pytest.mark.usefixtures("timed")
@pytest.mark.parametrize("size", [6, 7])
def test_a_discharge_coefficient_that_holds_the_density_already_is_refused(
    units: pint.UnitRegistry[Any], size: int
) -> None:
    """The trap of table 2.1: 2.915e-2 is 0.6 sqrt(2/rho), and eq. 2.1 takes the root again."""
    sound = parameters_with_units(units)
    twice = sound._replace(discharge_coefficient=0.6 * np.sqrt(2.0 / sound.density))
    assert twice.discharge_coefficient.magnitude == pytest.approx(2.915e-2, rel=2e-4)
    with pytest.raises(pint.DimensionalityError):
        check_units(units, size, GENERIC["extending", "sliding"], twice)


@pytest.mark.usefixtures("timed")
@pytest.mark.parametrize(
    "name",
    [
        "piston_area",
        "moving_mass",
        "stroke_min",
        "stroke_max",
        "line_volume_1",
        "line_volume_2",
        "bulk_modulus",
        "density",
        "supply_pressure",
        "return_pressure",
        "discharge_coefficient",
        "area_gradient",
        "valve_gain",
        "valve_natural_frequency",
        "valve_damping",
        "stiction",
        "coulomb",
        "stribeck_velocity",
        "viscous",
        "stick_velocity",
    ],
)
def test_a_wrong_unit_of_any_parameter_is_noticed(units: pint.UnitRegistry[Any], name: str) -> None:
    sound = parameters_with_units(units)
    wrong = sound._replace(**{name: getattr(sound, name) * units.Quantity(1.0, "K")})
    with pytest.raises(pint.DimensionalityError):
        check_units(units, 6, GENERIC["extending", "sliding"], wrong)
