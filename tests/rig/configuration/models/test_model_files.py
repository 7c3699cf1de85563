"""Model files: inheritance, effects, and a round trip without a bit lost."""

import math
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, strategies as st

from rig.configuration import ConfigError, check
from rig.configuration.models.model import SHIFTABLE, load_model
from rig.configuration.models.model_writing import dump_model
from rig.plant.added_terms import (
    FORMS,
    MOST_TERMS,
    PLACES,
    QUANTITIES,
    AddedTerm,
    fields_of,
    terms_of,
)
from rig.plant.effects import CATALOGUE, Model, PlantEffect
from rig.plant.parameters import (
    FRICTION_LAWS,
    KARNOPP,
    MOST_KNOTS,
    MOST_TABLES,
    NOMINAL,
    quantities,
)


def write(folder: Path, text: str, name: str = "model.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


def problems_of(path: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_model(path)
    return [str(problem).replace(f"{path.parent}/", "") for problem in caught.value.problems]


def test_the_nominal_model_is_table_2_1_as_built_in() -> None:
    nominal = load_model("nominal")
    assert nominal.parameters == NOMINAL
    assert nominal.effects == ()


def test_the_thesis_model_is_the_nominal_one_with_karnopp_friction() -> None:
    assert load_model("thesis").parameters == NOMINAL._replace(friction_law=KARNOPP)


def test_a_child_keeps_its_parents_parameters_and_effects(tmp_path: Path) -> None:
    write(tmp_path, "name: old\nparameters: {viscous: 400 N s/m}\neffects: {spool_null_bias: 3 um}")
    path = write(
        tmp_path,
        "name: young\nparent: model.yaml\neffects:\n"
        "  spring_load: {stiffness: 2e4 N/m, contact: 0.25 m}\n",
        "young.yaml",
    )
    model = load_model(path)
    assert model.effects == ("spool_null_bias", "spring_load")
    assert model.parameters == NOMINAL._replace(
        viscous=400.0, spool_null_bias=3e-6, spring_stiffness=2e4, spring_contact=0.25
    )


def test_an_inherited_effect_can_be_switched_off(tmp_path: Path) -> None:
    write(tmp_path, "name: old\neffects: {spool_null_bias: 3 um}")
    path = write(
        tmp_path, "name: x\nparent: model.yaml\neffects: {spool_null_bias: none}", "x.yaml"
    )
    assert load_model(path) == Model("x")


def test_a_signed_percentage_deviates_from_the_parent(tmp_path: Path) -> None:
    path = write(tmp_path, "name: x\nparent: nominal\nparameters: {bulk_modulus: -4 %}")
    assert load_model(path).parameters.bulk_modulus == 0.96 * 689e6


def test_supply_pressure_may_be_a_parameter_or_an_effect_but_not_both(tmp_path: Path) -> None:
    parameter = write(tmp_path, "name: x\nparameters: {supply_pressure: 10 MPa}")
    assert load_model(parameter) == Model("x", NOMINAL._replace(supply_pressure=1e7))
    effect = write(tmp_path, "name: x\neffects: {supply_pressure: 10 MPa}")
    assert load_model(effect).effects == ("supply_pressure",)
    both = write(
        tmp_path,
        "name: x\nparameters:\n  supply_pressure: 10 MPa\neffects:\n  supply_pressure: 11 MPa\n",
    )
    assert problems_of(both) == [
        "model.yaml:5:3 supply_pressure: 11 MPa is given as a parameter too; keep one of them"
    ]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (
            "parameters: {spool_null_bias: 3 um}",
            "spool_null_bias: is not a known key; set it under effects: {spool_null_bias: ...}",
        ),
        (
            "parameters: {spring_stiffness: 2e4 N/m}",
            "spring_stiffness: is not a known key; "
            "set it under effects: {spring_load: {stiffness: ...}}",
        ),
        (
            "effects: {spring_load: 2e4 N/m}",
            "spring_load: 2e4 N/m lacks its parameters; give {stiffness, contact}",
        ),
        (
            "friction_law: bristles",
            "friction_law: bristles is not a choice here; did you mean bristle?",
        ),
        (
            "parameters: {stiction: 1 kN}",
            "stiction: 1 kN is below coulomb (1.1 kN); correct stiction or coulomb",
        ),
        (
            "effects: {friction_asymmetry: +10 %}",
            "friction_asymmetry: +10 % is a share of zero; give the value itself, at most 1 kN",
        ),
        (
            "parameters: {viscous: -300 %}",
            "viscous: -300 % gives -700 N s/m, below 0 N s/m; deviate less from 350 N s/m",
        ),
        ("parent: x", "parent: x is not a known model; available models: nominal, thesis"),
        ("parent: model.yaml", "parent: model.yaml descends from this model; name another parent"),
        ("provenance: [1]", "provenance: [1] is not a mapping; give keys"),
    ],
)
def test_a_mistake_in_a_model_is_named_with_its_remedy(
    tmp_path: Path, text: str, problem: str
) -> None:
    found = problems_of(write(tmp_path, f"name: x\n{text}\n"))
    assert len(found) == 1
    assert found[0].split(" ", 1)[1].startswith(problem)
    assert found[0].startswith("model.yaml:2:")


def test_models_that_descend_from_each_other_are_refused(tmp_path: Path) -> None:
    first = write(tmp_path, "name: a\nparent: b.yaml", "a.yaml")
    write(tmp_path, "name: b\nparent: a.yaml", "b.yaml")
    assert problems_of(first) == [
        "b.yaml:2:1 parent: a.yaml descends from this model; name another parent"
    ]


FIELDS = {name: quantity for name, quantity in quantities().items() if name != "friction_law"}
EFFECT_FIELDS = {p.field: effect.name for effect in CATALOGUE.values() for p in effect.parameters}
READABLE_CHARACTERS = st.characters(exclude_characters="\0")
READABLE = st.text(READABLE_CHARACTERS)
"""Texts that a file may hold: one with a character of value zero is refused."""
PROVENANCE: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | READABLE,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(READABLE, inner, max_size=3),
    max_leaves=8,
)


@st.composite
def models(draw: st.DrawFn) -> Model:
    """Draw any model a file may hold: ranges kept, effects on wherever they act."""
    values = {name: draw(st.floats(q.lower, q.upper)) for name, q in FIELDS.items()}
    low, high = sorted((values["stroke_min"], values["stroke_max"]))
    values |= {"stroke_min": low, "stroke_max": max(high, low + 0.01, 0.01)}
    low, high = sorted((values["coulomb"], values["stiction"]))
    values |= {"coulomb": low, "stiction": high}
    values["supply_pressure"] = max(values["supply_pressure"], values["return_pressure"] + 1.0)
    effects = draw(st.lists(st.sampled_from(sorted(CATALOGUE)), unique=True))
    for field, effect in EFFECT_FIELDS.items():
        if effect not in effects and field not in SHIFTABLE:
            values[field] = getattr(NOMINAL, field)
    values["friction_law"] = draw(st.sampled_from(list(FRICTION_LAWS.values())))
    provenance = draw(st.dictionaries(READABLE, PROVENANCE, max_size=4))
    # No name may hold NUL, which ends a path for the operating system.
    name = draw(st.text(READABLE_CHARACTERS, min_size=1))
    return Model(name, NOMINAL._replace(**values), tuple(effects), provenance)


@given(model=models())
def test_a_written_model_reads_back_without_a_bit_lost(
    tmp_path_factory: pytest.TempPathFactory, model: Model
) -> None:
    path = tmp_path_factory.mktemp("models") / "written.yaml"
    dump_model(model, path)
    read = load_model(path)
    assert read == model
    # Zeros of either sign compare equal; the file keeps even that.
    assert [math.copysign(1.0, value) for value in read.parameters] == [
        math.copysign(1.0, value) for value in model.parameters
    ]


@pytest.mark.parametrize(
    ("text", "coulomb", "stiction"),
    [
        ("effects: {coulomb_level: 2.2 kN}", 2200.0, 4800.0),
        ("effects: {coulomb_level: 2.2 kN}\nparameters: {stiction: 3 kN}", 2200.0, 3000.0),
        ("effects: {coulomb_level: 2.2 kN, stiction_level: 3 kN}", 2200.0, 3000.0),
        ("effects: {stiction_level: 3 kN, coulomb_level: 2.2 kN}", 2200.0, 3000.0),
        ("effects: {stiction_level: 3 kN}", 1100.0, 3000.0),
        ("parameters: {coulomb: 2 kN}", 2000.0, 2400.0),
    ],
)
def test_a_coulomb_level_takes_the_stiction_along_unless_the_file_gives_it(
    tmp_path: Path, text: str, coulomb: float, stiction: float
) -> None:
    parameters = load_model(write(tmp_path, f"name: x\n{text}\n")).parameters
    assert (parameters.coulomb, parameters.stiction) == (coulomb, stiction)


@pytest.mark.parametrize("effect", CATALOGUE.values(), ids=CATALOGUE)
def test_every_effect_is_written_and_read(tmp_path: Path, effect: PlantEffect) -> None:
    values = {
        knob.name: 0.75 * knob.neutral + 0.25 * (knob.upper if knob.upper > knob.neutral
                                                 else knob.lower)
        for knob in effect.parameters
    }  # fmt: skip
    model = Model("x").with_effect(effect.name, **values)
    if effect.name == "coulomb_level":
        model = model.with_effect("coulomb_level", value=1200.0)
    dump_model(model, tmp_path / "written.yaml")
    assert load_model(tmp_path / "written.yaml") == model
    assert model.parameters != NOMINAL


def test_an_effect_that_acts_unannounced_is_written_as_switched_on(tmp_path: Path) -> None:
    path = tmp_path / "written.yaml"
    dump_model(Model("x", NOMINAL._replace(spool_null_bias=2e-6)), path)
    assert load_model(path) == Model("x").with_effect("spool_null_bias", value=2e-6)


def test_a_model_that_no_file_may_hold_is_not_written_and_leaves_nothing(tmp_path: Path) -> None:
    impossible = Model("x", NOMINAL._replace(bulk_modulus=math.nan, supply_pressure=138e6))
    with pytest.raises(ConfigError) as caught:
        dump_model(impossible, tmp_path / "written.yaml")
    assert [problem.field for problem in caught.value.problems] == [
        "bulk_modulus",
        "supply_pressure",
    ]
    assert list(tmp_path.iterdir()) == []


def test_a_model_replaces_its_old_file_whole(tmp_path: Path) -> None:
    path = write(tmp_path, "name: old\n" + "# long\n" * 5000)
    dump_model(Model("new"), path)
    assert load_model(path) == Model("new")
    assert [file.name for file in tmp_path.iterdir()] == ["model.yaml"]


@st.composite
def terms(draw: st.DrawFn, others: bool = False) -> tuple[AddedTerm, ...]:
    """Draw terms that a model holds, or others that it only keeps."""
    number = st.floats(-1e12, 1e12)
    found = []
    for _ in range(draw(st.integers(1, MOST_TERMS))):
        form = draw(st.sampled_from([form for form in FORMS if others or form != "table"]))
        of = "" if form == "1" else draw(st.sampled_from(tuple(QUANTITIES)[1:]))
        at = draw(st.floats(1e-3, 10.0)) if form in ("wave", "bump", "hinge") else 0.0
        by = draw(st.floats(1e-3, 10.0)) if form in ("wave", "bump") else 0.0
        place = draw(st.sampled_from(tuple(PLACES)))
        if others:
            place = draw(
                st.sampled_from(["command", "parameter viscous", "parameter pressure_1_gain"])
            )
            of = of and draw(st.sampled_from([of, "time"]))
        table = form == "table"
        size, knots = (1.0, draw(tables())) if table else (draw(number), ())
        found.append(AddedTerm(place, of, form, draw(st.booleans()), size, at, by, knots))
    return tuple(found)


@st.composite
def tables(draw: st.DrawFn) -> tuple[tuple[float, float], ...]:
    number = st.floats(-1e12, 1e12)
    at = sorted(draw(st.sets(number, min_size=2, max_size=MOST_KNOTS)))
    return tuple((x, draw(number)) for x in at)


@given(added=terms())
def test_terms_in_symbols_are_written_and_read_without_a_bit_lost(
    tmp_path_factory: pytest.TempPathFactory, added: tuple[AddedTerm, ...]
) -> None:
    model = Model("with terms", NOMINAL._replace(**fields_of(added)))
    path = tmp_path_factory.mktemp("models") / "terms.yaml"
    dump_model(model, path)
    assert terms_of(load_model(path).parameters) == added


@given(knots=st.lists(tables(), min_size=1, max_size=MOST_TABLES), others=terms(others=True))
def test_tables_and_terms_that_the_plant_cannot_hold_are_written_and_read_without_a_bit_lost(
    tmp_path_factory: pytest.TempPathFactory,
    knots: list[tuple[tuple[float, float], ...]],
    others: tuple[AddedTerm, ...],
) -> None:
    held = (
        *(AddedTerm("spool", "velocity", "table", True, 1.0, knots=each) for each in knots),
        AddedTerm("force balance", "pressure 1", "hinge", False, 2e-5, 5e6),
    )
    model = Model("with tables", NOMINAL._replace(**fields_of(held)), discovered=others)
    path = tmp_path_factory.mktemp("models") / "tables.yaml"
    dump_model(model, path)
    assert load_model(path) == model


def test_the_older_name_of_discovered_is_still_read(tmp_path: Path) -> None:
    lines = "[{to: spool, of: command, form: x, size: 1e-6 m/(V)}]"
    old, new = (
        load_model(write(tmp_path, f"name: x\n{key}: {lines}\n", f"{key}.yaml"))
        for key in ("unknown_term", "discovered")
    )
    assert old == new
    assert old != Model("x")
    both = write(tmp_path, f"name: x\nunknown_term: {lines}\ndiscovered: {lines}\n")
    (problem,) = problems_of(both)
    assert "unknown_term: [a mapping] is the older name of discovered" in problem


def test_a_check_says_what_simulator_and_filters_ignore_and_what_blinds_the_detector(
    tmp_path: Path,
) -> None:
    path = write(
        tmp_path,
        """\
name: x
discovered:
  - {to: force balance, of: time, form: table, at: [0 s, 40 s], values: [0 N, 30 N]}
  - {to: leak across the piston, form: constant, size: 1e-9 m^3/(s Pa^0.5)}
  - {to: force balance, form: constant, against_motion: true, size: 30 N}
""",
    )
    assert str(check(path)).splitlines()[2:] == [
        "  added to leak across the piston: constant; the detector is blind to a leak that looks "
        "like it",
        "  added to force balance: constant times the direction of motion",
        "  added to force balance: table of time; simulator and filters ignore it",
    ]


def test_all_that_is_wrong_with_tables_is_told_at_once(tmp_path: Path) -> None:
    path = write(
        tmp_path,
        """\
name: x
discovered:
  - {to: spool, of: velocity, form: table, at: [0 m/s, -1 m/s, 2 N], values: [0 m, 1 m]}
  - {to: spool, of: velocity, form: table, values: 3 m, size: 1 m}
  - {to: spool, of: velocity, form: table, at: [0 m/s, 0 m/s, 1 m/s], values: [0 m, 1 m]}
""",
    )
    assert sorted(problem.partition(" ")[2] for problem in problems_of(path)) == [
        "at[1]: 0 m/s is not above the one before it; write them in ascending order",
        "at[2]: 2 N is not a velocity; write a velocity, such as 0.04 m/s",
        "discovered[1]: lacks the key at; write `at: [-0.2 m/s, 0 m/s, 0.2 m/s]` and as many "
        "values, `values: [-30 N, 0 N, 45 N]`",
        "size: is not of form table; leave it out",
        "values: 3 m is not a list of 2 to 9 quantities; write `at: [-0.2 m/s, 0 m/s, 0.2 m/s]` "
        "and as many values, `values: [-30 N, 0 N, 45 N]`",
        "values: has 2 entries, but `at` has 3; give one value for each position",
    ]


@pytest.mark.parametrize(("form", "most"), [("x, size: 1 m/(V)", 3), ("table", 2)])
def test_more_terms_than_a_model_holds_are_refused(tmp_path: Path, form: str, most: int) -> None:
    line = f"  - {{to: spool, of: command, form: {form}"
    line += ", at: [0 V, 1 V], values: [0 m, 1e-6 m]}\n" if form == "table" else "}\n"
    path = write(tmp_path, "name: x\ndiscovered:\n" + line * (most + 1))
    (problem,) = problems_of(path)
    assert f"model.yaml:{most + 3}:" in problem
    assert f"a model holds at most {most}" in problem


def test_no_more_terms_beside_the_plants_are_taken_than_the_workflow_has_room_for(
    tmp_path: Path,
) -> None:
    line = "  - {to: bulk modulus, of: time, form: x, size: 1 Pa/(s)}\n"
    assert len(load_model(write(tmp_path, "name: x\ndiscovered:\n" + line * 4)).discovered) == 4
    (problem,) = problems_of(write(tmp_path, "name: x\ndiscovered:\n" + line * 5))
    assert "model.yaml:7:5 discovered[4]: is one of 5 terms that are not of the plant" in problem


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ("{}", "discovered: a mapping is not a list of at most 3 terms"),
        ("[{to: force, form: constant, size: 1 N}]", "to: force is not a choice here"),
        ("[{to: spool, form: constant, size: 1 N}]", "size: 1 N is not a length"),
        ("[{to: spool, form: x, size: 1}]", "discovered[0]: lacks the key of, the quantity that"),
        ("[{to: spool, of: comand, form: x, size: 1 m/(V)}]", "of: comand is not a choice here"),
        ("[{to: spool, form: constant, of: command, size: 1 m}]", "of: command does not go"),
        ("[{to: spool, form: constant, size: 1 m, pitch: 1 m}]", "pitch: is not of form"),
        ("[{to: spool, form: wave, of: position, size: 1 m, phase: 1 rad}]",
         "discovered[0]: lacks the key pitch; add `pitch: ... m`"),
        ("[{to: spool, form: constant}]", "discovered[0]: lacks the key size; add `size: ... m`"),
        ("[{to: spool, form: constant, size: 1 m, sise: 2}]", "sise: is not a known key"),
    ],
)  # fmt: skip
def test_a_term_that_cannot_be_is_reported(tmp_path: Path, lines: str, problem: str) -> None:
    path = write(tmp_path, f"name: x\ndiscovered: {lines}\n")
    found = problems_of(path)
    assert len(found) == 1, found
    assert problem in found[0]
