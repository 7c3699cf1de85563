"""Terms in symbols: absent to the last bit, and what their formulas say where they are on."""

from math import exp, pi, sin

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.plant import KARNOPP, NOMINAL, Model, Parameters
from rig.plant.added_terms import FORMS, PLACES, QUANTITIES, AddedTerm, fields_of, terms_of
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
    assert [term.size_unit for term in terms] == ["N", "m/(V)^2", "N"]
    with pytest.raises(ValueError, match="holds 3"):
        fields_of((*terms, terms[0]))


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
}  # fmt: skip


@pytest.mark.parametrize("name", SAME)
def test_a_term_does_what_the_same_parameter_does(name: str) -> None:
    term, changes = SAME[name]
    by_term, by_parameter, plain = run(model(term)), run(model(**changes)), run(model())
    for state in ("velocity", "pressure_1", "pressure_2"):
        shift = np.linalg.norm(by_parameter[state] - plain[state])
        assert np.linalg.norm(by_term[state] - by_parameter[state]) < 0.01 * shift


def forms(x: float, at: float, by: float) -> dict[str, float]:
    return {
        "1": 1.0, "x": x, "|x|": abs(x), "x^2": x * x, "x |x|": x * abs(x),
        "wave": sin(2.0 * pi * x / at + by), "bump": exp(-(((x - at) / by) ** 2)),
    }  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("command", [-1.7, 0.4, 3.1])
def test_a_form_is_its_formula(form: str, command: float) -> None:
    # A shift of the spool's reference that hangs on the command shows where the spool comes to.
    at, by, size = 0.9, 0.6, 3e-6
    of = "" if form == "1" else "command"
    tested = model(AddedTerm("spool", of, form, False, size, at, by))
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
    assert Parameters._fields[-12] == "term_1_kind"
