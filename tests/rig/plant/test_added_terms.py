"""Added terms: absent to the last bit, and what their formulas say where they are on."""

from math import exp, pi, sin

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from rig.plant import KARNOPP, NOMINAL, Model, Parameters
from rig.plant.added_terms import (
    FORMS,
    PLACES,
    QUANTITIES,
    AddedTerm,
    fields_of,
    terms_of,
    unit_per,
)
from rig.plant.simulation import simulate

Array = NDArray[np.float64]
COMMAND = 4.0 * np.sin(2.0 * np.pi * np.arange(1500) * 1e-3)


def model(*terms: AddedTerm, **changes: float) -> Model:
    return Model(parameters=NOMINAL._replace(**fields_of(terms), **changes))


def run(tested: Model) -> dict[str, Array]:
    return simulate(tested, COMMAND, position=0.3)


def test_parameters_hold_terms_and_give_them_back() -> None:
    terms = (
        AddedTerm("force balance", "position", "wave", False, 180.0, 0.042, 0.4),
        AddedTerm("spool", "command", "x |x|", False, 1e-8),
        AddedTerm("force balance", "", "1", True, 30.0),
    )
    assert terms_of(model(*terms).parameters) == terms
    assert terms_of(NOMINAL) == ()
    units = [unit_per(PLACES[t.place], QUANTITIES[t.of], t.form) for t in terms]
    assert units == ["N", "m/(V)^2", "N"]
    with pytest.raises(ValueError, match="holds 3"):
        fields_of((*terms, terms[0]))


def table(of: str, at: ArrayLike, values: ArrayLike, place: str = "force balance") -> AddedTerm:
    """Return a table as a term."""
    knots = tuple(zip(np.array(at, float).tolist(), np.array(values, float).tolist(), strict=True))
    return AddedTerm(place, of, "table", False, 1.0, knots=knots)


def test_tables_come_first_and_keep_their_knots() -> None:
    constant = AddedTerm("force balance", "", "1", True, 30.0)
    short, whole = (
        table("position", np.linspace(0.0, 0.4, n) ** 2, np.arange(n) - 3.0) for n in (2, 9)
    )
    assert terms_of(model(constant, short, whole).parameters) == (short, whole, constant)


@pytest.mark.parametrize(
    ("terms", "problem"),
    [
        ([table("position", np.arange(3), np.ones(3))] * 3, "3 tables; .* holds 2 tables"),
        ([table("position", np.arange(10), np.ones(10))], "10 knots; a table has 2 to 9"),
        ([table("position", np.array([0.0, 0.0]), np.ones(2))], "not in strictly ascending"),
    ],
)
def test_tables_that_cannot_be_held_are_refused(terms: list[AddedTerm], problem: str) -> None:
    with pytest.raises(ValueError, match=problem):
        fields_of(tuple(terms))


AT = np.array([-0.6, -0.2, -0.05, 0.0, 0.1, 0.7])
"""Velocities in m/s between which a table that is linear lies on its line."""
SYMBOLS = {
    "x": lambda v: 400.0 * v,
    "|x|": lambda v: 400.0 * np.abs(v),
    "hinge": lambda v: 400.0 * np.maximum(v - 0.1, 0.0),
}  # fmt: skip


@pytest.mark.parametrize("form", SYMBOLS)
def test_a_table_equals_the_form_in_symbols_that_it_samples(form: str) -> None:
    at = 0.1 if form == "hinge" else 0.0
    symbols = run(model(AddedTerm("force balance", "velocity", form, False, 400.0, at)))
    sampled = run(model(table("velocity", AT, SYMBOLS[form](AT))))
    plain = run(model())
    for state in ("velocity", "pressure_1", "pressure_2"):
        shift = np.abs(symbols[state] - plain[state]).max()
        assert np.abs(sampled[state] - symbols[state]).max() < 1e-6 * shift


def test_two_tables_add_up() -> None:
    halves = [table("position", np.array([0.0, 0.6]), np.array([0.0, 90.0]))] * 2
    whole = table("position", np.array([0.0, 0.6]), np.array([0.0, 180.0]))
    both, one = run(model(*halves)), run(model(whole))
    for state in ("velocity", "pressure_1"):
        np.testing.assert_allclose(both[state], one[state], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("law", [0.0, KARNOPP], ids=["bristle", "karnopp"])
def test_terms_of_no_size_are_no_terms(law: float) -> None:
    for place in PLACES:
        nothing = AddedTerm(place, "velocity", "x |x|", True, 0.0)
        plain, with_it = run(model(friction_law=law)), run(model(nothing, friction_law=law))
        for state in plain:
            scale = np.abs(plain[state]).max()
            assert np.abs(with_it[state] - plain[state]).max() <= 1e-9 * scale


SAME = {
    "constant_force": (
        AddedTerm("force balance", "", "1", False, 400.0), {"constant_force": 400.0}
    ),
    "viscous": (
        AddedTerm("force balance", "velocity", "x", False, 150.0), {"viscous": 500.0}
    ),
    "coulomb": (
        AddedTerm("force balance", "", "1", True, 200.0), {"coulomb": 1300.0, "stiction": 2600.0}
    ),
    "spool shift": (
        AddedTerm("spool", "command", "x", False, 0.1 * NOMINAL.valve_gain),
        {"valve_gain": 1.1 * NOMINAL.valve_gain},
    ),
    "leaks": (
        AddedTerm("flow, chamber 1", "pressure 1", "x", False, -2e-12),
        {"external_leakage_1_linear": 2e-12},
    ),
    "leak across the piston": (
        AddedTerm("leak across the piston", "", "1", False, 4e-9), {"internal_leakage": 4e-9}
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_a_term_does_what_the_same_parameter_does(name: str) -> None:
    term, changes = SAME[name]
    by_term, by_parameter, plain = run(model(term)), run(model(**changes)), run(model())
    for state in ("velocity", "pressure_1", "pressure_2"):
        shift = np.linalg.norm(by_parameter[state] - plain[state])
        assert np.linalg.norm(by_term[state] - by_parameter[state]) < 0.01 * shift


def test_open_edges_pass_at_null_what_those_of_an_underlap_do() -> None:
    leaking = {"external_leakage_1": 1e-9}
    edges = model(AddedTerm("valve edges", "", "1", False, 4e-6), **leaking)
    underlap = model(valve_underlap_leakage=4e-6, **leaking)
    at_null = [simulate(tested, np.zeros(1500), position=0.3) for tested in (edges, underlap)]
    plain = simulate(model(**leaking), np.zeros(1500), position=0.3)
    for state in ("pressure_1", "pressure_2"):
        assert at_null[0][state][-1] == pytest.approx(at_null[1][state][-1], rel=1e-6)
        assert at_null[0][state][-1] > plain[state][-1] + 1e5


def forms(x: float, at: float, by: float) -> dict[str, float]:
    return {
        "1": 1.0, "x": x, "|x|": abs(x), "x^2": x * x, "x |x|": x * abs(x),
        "wave": sin(2.0 * pi * x / at + by), "bump": exp(-(((x - at) / by) ** 2)),
        "hinge": max(0.0, x - at), "table": float(np.interp(x, *np.array(KNOTS).T)),
    }  # fmt: skip


KNOTS = ((-1.5, 2.0), (-1.0, -1.0), (0.2, 0.5), (0.9, 3.0), (3.0, 4.0))


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("command", [-1.7, 0.4, 3.1])
def test_a_form_is_its_formula(form: str, command: float) -> None:
    # A shift of the spool's reference that hangs on the command shows where the spool comes to.
    at, by, size = 0.9, 0.6, 3e-6
    of = "" if form == "1" else "command"
    knots = KNOTS if form == "table" else ()
    tested = model(AddedTerm("spool", of, form, False, size, at, by, knots))
    # The spool has settled by a second and a half.
    reached = simulate(tested, np.full(1500, command), position=0.3)["spool"][-1]
    expected = NOMINAL.valve_gain * command + size * forms(command, at, by)[form]
    assert reached == pytest.approx(expected, abs=1e-14)


def test_a_tight_place_holds_the_ram_without_pushing_it() -> None:
    tight = model(AddedTerm("force balance", "position", "bump", True, 3e3, 0.32, 0.01))
    plain, held = run(model()), run(tight)
    inside = np.abs(plain["position"] - 0.32) < 0.005
    assert inside.any()
    load = lambda states: NOMINAL.piston_area * (states["pressure_1"] - states["pressure_2"])  # noqa: E731
    assert np.abs(load(held)).max() > np.abs(load(plain)).max() + 1e3
    assert np.isfinite(held["velocity"]).all()


def test_every_place_form_and_quantity_has_a_digit() -> None:
    assert max(len(PLACES), len(QUANTITIES), len(FORMS)) < 10
    assert Parameters._fields[-48] == "term_1_kind"
    assert Parameters._fields[-1] == "table_2_value_9"
