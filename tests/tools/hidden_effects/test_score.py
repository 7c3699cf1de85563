"""Answers are held against the envelope as the promises of the gap workflow are worded."""

from dataclasses import replace
from typing import Any

import pytest

from tools.hidden_effects.drawn_trials import Envelope
from tools.hidden_effects.score import scored


def envelope(*effects: str, kind: str = "single", **parameters: float) -> Envelope:
    hidden = {name: dict(parameters) or {"value": 1.0} for name in effects}
    off_menu = {"cogging": {"cogging": 1.0}} if kind == "off_menu" else {}
    return Envelope(1, 0, kind, hidden, off_menu, {}, {})


def answer(verdict: str, *sets: tuple[str, ...], **fields: Any) -> dict[str, Any]:
    effects = [
        {"name": names[0], "parameters": {}, "evidence": {}, "indistinguishable_from": names[1:]}
        for names in sets
    ]
    return {"verdict": verdict, "effects": effects, "gap": {"before": 4.0, "after": 0.4}, **fields}


@pytest.mark.parametrize(
    ("sets", "outcome"),
    [
        ([("command_delay",)], "right"),
        ([("valve_bandwidth", "command_delay")], "right"),
        ([("valve_bandwidth", "pressure_lag", "command_delay")], "right"),
        ([("valve_bandwidth", "pressure_lag", "supply_droop", "command_delay")], "wrong"),
        ([("valve_bandwidth",)], "wrong"),
        ([("command_delay",), ("supply_droop",)], "right and more"),
    ],
)
def test_one_effect_is_right_when_named_or_in_a_set_of_three(
    sets: list[tuple[str, ...]], outcome: str
) -> None:
    found = scored(envelope("command_delay"), answer("missing_effect", *sets))
    assert found.outcome == outcome


def test_names_beside_the_right_one_are_counted_as_false() -> None:
    sets = [("supply_droop", "return_back_pressure"), ("command_delay",)]
    found = scored(envelope("command_delay"), answer("missing_effect", *sets))
    assert found.false_names == ("supply_droop",)


@pytest.mark.parametrize(
    ("sets", "outcome"),
    [
        ([("a",), ("b",)], "right"),
        ([("b",), ("c", "a")], "right"),
        ([("a", "b")], "half"),
        ([("a", "b"), ("a", "c")], "right"),
        ([("a",), ("c",)], "half"),
        ([("c",), ("d",)], "wrong"),
        ([("a",), ("b",), ("c",)], "right and more"),
    ],
)
def test_two_effects_need_a_set_each(sets: list[tuple[str, ...]], outcome: str) -> None:
    found = scored(envelope("a", "b", kind="double"), answer("missing_effect", *sets))
    assert found.outcome == outcome


@pytest.mark.parametrize(
    ("kind", "verdict", "outcome"),
    [
        ("none", "adequate", "right"),
        ("none", "unknown_effect", "unknown"),
        ("none", "inconclusive", "inconclusive"),
        ("off_menu", "unknown_effect", "right"),
        ("off_menu", "adequate", "missed"),
        ("off_menu", "missing_effect", "wrong"),
    ],
)
def test_where_nothing_on_the_menu_is_hidden_the_verdict_decides(
    kind: str, verdict: str, outcome: str
) -> None:
    assert scored(envelope(kind=kind), answer(verdict)).outcome == outcome


def test_naming_where_nothing_is_hidden_is_wrong() -> None:
    found = scored(envelope(kind="none"), answer("missing_effect", ("entrained_air",)))
    assert (found.outcome, found.false_names) == ("wrong", ("entrained_air",))


@pytest.mark.parametrize(
    ("verdict", "sets", "outcome"),
    [
        ("inconclusive", [], "right"),
        ("adequate", [], "right"),
        ("unknown_effect", [], "unknown"),
        ("missing_effect", [("a",)], "right"),
        ("missing_effect", [("b",)], "wrong"),
    ],
)
def test_what_the_motion_does_not_show_need_not_be_named_but_not_falsely_either(
    verdict: str, sets: list[tuple[str, ...]], outcome: str
) -> None:
    assert scored(envelope("a", kind="unexcited"), answer(verdict, *sets)).outcome == outcome


def test_a_hidden_effect_that_is_not_named_is_missed_or_unknown() -> None:
    outcomes = [
        scored(envelope("a"), answer(verdict)).outcome
        for verdict in ("adequate", "unknown_effect", "inconclusive")
    ]
    assert outcomes == ["missed", "unknown", "inconclusive"]


def test_a_verdict_that_is_none_is_a_failure_with_its_reason() -> None:
    found = scored(envelope("a"), {"verdict": "perhaps"})
    assert found.outcome == "failed"
    assert "'perhaps' is not one of adequate" in found.why


@pytest.mark.parametrize(
    ("answered", "inside"),
    [
        ({"value": 1.1, "interval": [0.9, 1.3]}, True),
        ({"value": 1.1, "interval": [1.3, 0.9]}, True),
        ({"value": 1.2, "low": 1.05, "high": 1.3}, False),
        ({"value": 1.2, "lower": 1.05, "upper": 1.3}, False),
        ({"value": 1.2}, None),
        (1.2, None),
    ],
)
def test_intervals_are_asked_for_the_true_value(answered: Any, inside: bool | None) -> None:
    found = answer("missing_effect", ("a",))
    found["effects"][0]["parameters"] = {"value": answered}
    (estimate,) = scored(envelope("a"), found).estimates
    assert estimate.inside is inside
    assert estimate.truth == 1.0


def test_a_phase_is_true_whole_turns_away() -> None:
    found = answer("missing_effect", ("supply_ripple",))
    found["effects"][0]["parameters"] = {"phase": {"value": -0.1, "interval": [-0.3, 0.1]}}
    (estimate,) = scored(envelope("supply_ripple", phase=6.2), found).estimates
    assert estimate.inside


def test_a_name_that_stands_in_for_the_true_one_has_no_parameter_to_judge() -> None:
    found = answer("missing_effect", ("b", "a"))
    found["effects"][0]["parameters"] = {"value": {"value": 1.0, "interval": [0.0, 2.0]}}
    assert scored(envelope("a"), found).estimates == ()


@pytest.mark.parametrize(
    ("gap", "shrinkage"),
    [
        ({"before": 4.0, "after": 0.4}, 0.9),
        ({"before": 4.0, "after": -0.1}, 1.0),
        ({"before": 0.01, "after": 0.0}, None),
        ({"before": None, "after": None}, None),
    ],
)
def test_the_gap_shrinks_by_the_share_that_is_gone(
    gap: dict[str, float | None], shrinkage: float | None
) -> None:
    found = scored(envelope("a"), answer("missing_effect", ("a",), gap=gap)).shrinkage
    assert found == (None if shrinkage is None else pytest.approx(shrinkage))


def off_menu(*places: tuple[str, str, str]) -> Envelope:
    listed = [{"equations": [e], "of": [of], "shapes": [shape]} for e, of, shape in places]
    return replace(envelope(kind="off_menu"), places={"gremlins": listed})


@pytest.mark.parametrize(
    ("entry", "placed", "shaped", "among"),
    [
        (("tone", "force balance", "time"), True, True, True),
        (("trend", "force balance", "time"), True, False, True),
        (("tone", "flow, chamber 1", "time"), False, False, False),
        (("play", "reading of pressure_1_Pa", "pressure 1"), True, True, True),
        (("tone", "spool", "", "play in reading of pressure 1 of pressure 1"), False, False, True),
        (("lag", "command", ""), True, True, True),
    ],
)
def test_a_discovery_is_right_if_its_place_is_and_its_shape_is_judged_beside(
    entry: tuple[str, ...], placed: bool, shaped: bool, among: bool
) -> None:
    hidden = off_menu(
        ("force balance", "time", "tone"),
        ("reading of pressure 1", "pressure 1", "play"),
        ("command", "", "lag"),
    )
    name, equation, of, *also = entry
    discovered = [{"name": name, "equation": equation, "of": of, "could_also_be": also}]
    found = scored(hidden, {**answer("unknown_effect"), "discovered": discovered})
    assert (found.placed, found.shaped, found.discovered[0].among) == (placed, shaped, among)
    assert found.outcome == "right"


def test_parameters_of_another_form_have_no_true_value() -> None:
    found = answer("missing_effect", ("a",))
    found["effects"][0] |= {"parameters": {"value": {"value": 1.0, "interval": [0.0, 2.0]}},
                            "form": "corrected"}  # fmt: skip
    hidden = replace(envelope("a"), forms={"a": "laminar"})
    score = scored(hidden, found)
    assert (score.outcome, score.estimates, score.forms) == ("right", (), (("a", "corrected"),))
