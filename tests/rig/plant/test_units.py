"""Every equation of the plant holds in units, and breaking one does not go unnoticed.

The source of `rig.plant.dynamics` runs uncompiled on pint quantities: whatever adds pascals to
metres, or leaves a rate in another unit than its state's per second, raises.
"""

import inspect
from collections.abc import Callable
from itertools import product
from typing import Any, Final

import pint
import pytest

from rig.plant import KARNOPP, NOMINAL, FaultInput, Parameters, dynamics, quantities
from rig.plant.dynamics import PlantState
from rig.plant.parameters import Quantity
from rig.plant.sensors import SensorParameters

UNITS: Final[pint.UnitRegistry[float]] = pint.UnitRegistry()
Q = UNITS.Quantity

SOURCE: Final = inspect.getsource(dynamics)

STATE_UNITS: Final = ("m", "m/s", "Pa", "Pa", "m", "m/s", "m", "Pa", "Pa")
KARNOPP_UNITS: Final = (*STATE_UNITS[:6], "", *STATE_UNITS[7:])
FAULT_UNITS: Final = (
    *("m^3/(s Pa^0.5)",) * 3, *("m^3/(s Pa)",) * 3, "m^3/(s Pa^0.5)", "Pa/(m^3/s)^2",
)  # fmt: skip

SITUATIONS: Final = {
    "extending against spring and stroke end": PlantState(
        1e-4, 0.01, 9e6, 4e6, 0.608, 0.02, 1e-5, 13e6, 2e5
    ),
    "retracting past the other end": PlantState(
        -1e-4, 0.01, 4e6, 9e6, -1e-4, -0.02, -1e-5, 13e6, 2e5
    ),
    "cavitating in chamber 1": PlantState(1e-4, 0.0, -1e5, 4e6, 0.3, 0.5, 5e-5, 13e6, 2e5),
    "cavitating in chamber 2": PlantState(-1e-4, 0.0, 4e6, -1e5, 0.3, -0.5, -5e-5, 13e6, 2e5),
}
WITH_EVERYTHING: Final = NOMINAL._replace(
    entrained_air=0.01,
    valve_deadband=1e-6,
    valve_underlap_leakage=2e-6,
    valve_flow_asymmetry=0.1,
    valve_rate_limit=5e-3,
    constant_force=500.0,
    payload_mass=20.0,
    stop_low=0.001,
    stop_high=0.6,
    supply_droop=5e12,
    return_back_pressure=5e12,
    friction_asymmetry=100.0,
    spring_stiffness=6e5,
    external_leakage_1=1e-9,
    external_leakage_2=1e-9,
    internal_leakage=1e-9,
    external_leakage_1_linear=1e-12,
    external_leakage_2_linear=1e-12,
    internal_leakage_linear=1e-12,
    supply_leakage=1e-9,
)
WITH_PLAIN_EDGES: Final = WITH_EVERYTHING._replace(
    valve_deadband=0.0, valve_underlap_leakage=0.0, valve_flow_asymmetry=0.0
)
LEAKING: Final = (Q(9, "MPa"), Q(4, "MPa"), Q(0, "MPa"))
FAULT: Final = FaultInput(*(1e-9,) * 3, *(1e-12,) * 3, 1e-9, 1e12)


def with_units(values: Any, units: Any) -> Any:
    """Return a named tuple of numbers as one of quantities."""
    return type(values)(*(Q(value, unit) for value, unit in zip(values, units, strict=True)))


def in_units(parameters: Parameters) -> Any:
    known = quantities()
    # Terms in symbols have the units of their kind; there are none here.
    units = [known[name].unit if name in known else "" for name in Parameters._fields]
    return with_units(parameters, units)


def with_sign(quantity: Any, other: Any) -> Any:
    """Return a quantity, which is not negative, with the sign of another of whatever unit."""
    return quantity if other >= 0.0 else -quantity


def uncompiled(source: str = SOURCE) -> dict[str, Any]:
    """Return the names that the source defines, its functions uncompiled and fit for quantities."""
    for old, new in (
        ("from rig.jit import njit", "njit = lambda **options: (lambda function: function)"),
        ("from .compiled import inlined, inner", "inlined = inner = lambda function: function"),
        ("from math import copysign, exp, sin, sqrt", "from numpy import exp, sin, sqrt"),
        ("from .", "from rig.plant."),
    ):
        assert old in source
        source = source.replace(old, new)
    names: dict[str, Any] = {"__name__": "dynamics_in_units", "copysign": with_sign}
    exec(compile(source, "dynamics_in_units", "exec"), names)
    names["LEVEL_FLOOR"] = Q(names["LEVEL_FLOOR"], "N")
    names["ATMOSPHERE"] = Q(names["ATMOSPHERE"], "Pa")
    return names


def check_rates(names: dict[str, Any]) -> None:
    """Raise unless every rate is its state's unit per second, in every situation and law."""
    for law, rig in product((0.0, KARNOPP), (WITH_EVERYTHING, WITH_PLAIN_EDGES)):
        par = in_units(rig._replace(friction_law=law))
        units = KARNOPP_UNITS if law == KARNOPP else STATE_UNITS
        for situation in SITUATIONS.values():
            state = situation._replace(friction_state=1.0) if law == KARNOPP else situation
            rates = names["rates"](
                *with_units(state, units), Q(2.0, "V"), par, with_units(FAULT, FAULT_UNITS)
            )
            for rate, unit in zip(rates, units, strict=True):
                if unit:
                    Q(rate).ito(f"({unit}) / s")
                else:  # the direction of sliding, which changes between steps only
                    assert rate == 0.0


def test_every_rate_is_its_states_unit_per_second() -> None:
    check_rates(uncompiled())


def test_uncompiled_quantities_and_compiled_numbers_agree() -> None:
    rates = uncompiled()["rates"]
    for state in SITUATIONS.values():
        found = rates(
            *with_units(state, STATE_UNITS),
            Q(2.0, "V"),
            in_units(WITH_EVERYTHING),
            with_units(FAULT, FAULT_UNITS),
        )
        compiled = dynamics.rates(*state, 2.0, WITH_EVERYTHING, FAULT)
        in_si = [rate.to_base_units().magnitude for rate in found]
        assert in_si == pytest.approx(compiled, rel=1e-9)


@pytest.mark.parametrize(
    ("function", "arguments", "unit"),
    [
        ("signed_root", lambda par: (Q(4.0, "MPa"),), "Pa^0.5"),
        ("valve_conductance", lambda par: (par,), "m^2/(s Pa^0.5)"),
        ("aeration_softening", lambda par: (Q(0.2, "MPa"), par), ""),
        ("aeration_compliance", lambda par: (Q(0.2, "MPa"), par), "1/Pa"),
        ("chamber_volumes", lambda par: (Q(30.0, "cm"), par), "m^3"),
        ("slip_friction", lambda par: (Q(1.0, "m/s"), Q(1.0, "m/s"), par), "N"),
        ("spring_force", lambda par: (Q(61.0, "cm"), par), "N"),
        ("stops", lambda par: (par,), "m"),
        ("total_mass", lambda par: (par,), "kg"),
        ("lapped", lambda par: (Q(0.1, "mm"), par), "m"),
        ("environment_force", lambda par: (Q(61.0, "cm"), Q(1.0, "m/s"), par), "N"),
        (
            "leak_flows",
            lambda par: (*LEAKING, par, with_units(FAULT, FAULT_UNITS)),
            "m^3/s",
        ),
        (
            "edge_flows",
            lambda par: (
                Q(0.1, "mm"), Q(9, "MPa"), Q(4, "MPa"), Q(13, "MPa"), Q(0, "MPa"), par,
            ),
            "L/min",
        ),
        (
            "valve_flows",
            lambda par: (
                Q(0.1, "mm"), Q(9, "MPa"), Q(4, "MPa"), Q(13, "MPa"), Q(0, "MPa"),
                Q(6e-4, "m^2/(s Pa^0.5)"),
            ),
            "L/min",
        ),
    ],
)  # fmt: skip
def test_each_function_returns_what_its_docstring_says(
    function: str, arguments: Callable[[Any], tuple[Any, ...]], unit: str
) -> None:
    names = uncompiled()
    found = names[function](*arguments(in_units(WITH_EVERYTHING)))
    for value in found if isinstance(found, tuple) else (found,):
        assert value.is_compatible_with(unit)
    documented = unit if unit != "L/min" else "m^3/s"
    assert f"{documented}" in names[function].__doc__


BROKEN: Final = {
    "the area gradient left out": (
        "par.discharge_coefficient * par.area_gradient * sqrt",
        "par.discharge_coefficient * sqrt",
    ),
    "sqrt(2/rho) taken twice, as table 2.1 prints C_d": (
        "sqrt(2.0 / par.density)",
        "sqrt(2.0 / par.density) * sqrt(2.0 / par.density)",
    ),
    "no root of the drop across the edge": ("flow * signed_root(drop_1)", "flow * drop_1"),
    "a turbulent leak with the drop itself": ("k1 * signed_root(p1 - back)", "k1 * (p1 - back)"),
    "a laminar leak with the root": ("l12 * (p1 - p2)", "l12 * signed_root(p1 - p2)"),
    "volume as length": ("par.piston_area * (position", "(position"),
    "stiffness of one chamber": ("(v1 * hard_1 * v2 * hard_2)", "(v1 * hard_1 * hard_2)"),
    "swept volume without velocity": ("= par.piston_area * v\n", "= par.piston_area\n"),
    "a cavity in pascals": ("_excess(-p1) / (stiffness_1 * v1)", "_excess(-p1)"),
    "bubbles without their pressure": ("bubbles = air * ATMOSPHERE", "bubbles = air"),
    "bubbles as stiff as oil": ("par.bulk_modulus * bubbles", "bubbles"),
    "valve command in volts (k_sp left out)": ("par.valve_gain * command", "command"),
    "the natural frequency once": ("wn * wn * (", "wn * ("),
    "damping without it": (
        "2.0 * par.valve_damping * wn * velocity",
        "2.0 * par.valve_damping * velocity",
    ),
    "droop linear in the flow": ("drawn * abs(drawn)", "drawn"),
    "back pressure of the flow's root": ("returned * abs(returned)", "signed_root(returned)"),
    "lines without their time constant": ("dps * rate, dpe * rate", "dps, dpe"),
    "spring force without its way": (
        "par.spring_stiffness * _excess(position - par.spring_contact)",
        "par.spring_stiffness",
    ),
    "stroke end losing by the way": ("par.stop_damping * velocity", "par.stop_damping * above"),
    "Stribeck's velocity left out": ("-speed * (1.0 / par.stribeck_velocity)", "-speed"),
    "bristles relaxing without their level": ("friction_state / level", "friction_state"),
    "viscous friction of nothing": ("= par.viscous * velocity", "= par.viscous"),
    "bristle damping of the deflection": ("* bristle_velocity\n", "* friction_state\n"),
    "force for acceleration": ("(force - drag) * (1.0 / total_mass(par))", "force - drag"),
    "an overlap in proportion": ("abs(opening) - par.valve_deadband", "abs(opening) - 1.0"),
    "an underlap of pressure": (
        "_excess(par.valve_underlap_leakage + opening)",
        "_excess(par.supply_pressure + opening)",
    ),
    "an edge without its drop": ("forth * signed_root(supply - p1)", "forth"),
    "a spool limited by its way": ("limit = par.valve_rate_limit", "limit = par.valve_deadband"),
    "a force held as a mass": ("+ par.constant_force", "+ par.payload_mass"),
    "a payload in newtons": ("moving_mass + par.payload_mass", "moving_mass + par.constant_force"),
    "a stop in newtons": ("par.stop_high)", "par.stop_stiffness)"),
}


@pytest.mark.parametrize("equation", BROKEN)
def test_breaking_an_equation_breaks_its_units(equation: str) -> None:
    right, wrong = BROKEN[equation]
    assert right in SOURCE
    with pytest.raises(pint.DimensionalityError):
        check_rates(uncompiled(SOURCE.replace(right, wrong)))


@pytest.mark.parametrize("owner", [Parameters, SensorParameters])
def test_every_parameters_unit_is_one(owner: Any) -> None:
    hints = inspect.get_annotations(owner, eval_str=True)
    assert hints.keys() == set(owner._fields)
    for name, hint in hints.items():
        if name.startswith(("term_", "table_")):
            continue  # Their units are those of their kind (test_added_terms.py).
        (quantity,) = hint.__metadata__
        assert isinstance(quantity, Quantity), name
        UNITS.Unit(quantity.unit)
        assert quantity.lower < quantity.upper
        assert quantity.lower <= owner._field_defaults[name] <= quantity.upper
