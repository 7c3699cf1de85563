"""Faults and loads of campaign files: what is asked for, or why it cannot be."""

from math import inf
from pathlib import Path

import pytest

from faults.campaign import SpringLoad
from faults.verdict import Verdict
from rig.configuration import ConfigError
from rig.configuration.campaigns.campaign import load_campaign
from tests.rig.configuration.campaigns.written import HEAD, TEST, fault, only_test, problems_of


@pytest.mark.parametrize(
    ("size", "coefficient", "linear"),
    [
        ("coefficient: 4e-9 m^3/(s Pa^0.5)", 4e-9, False),
        ("coefficient: 4e-9 m^3/(s sqrt(Pa))", 4e-9, False),
        ("linear_coefficient: 2e-12 m^3/(s Pa)", 2e-12, True),
        ("flow: 0.6 L/min, pressure: 4 MPa", 5e-9, False),
    ],
)
def test_a_leak_may_be_sized_by_coefficient_or_flow(
    tmp_path: Path, size: str, coefficient: float, linear: bool
) -> None:
    test = only_test(tmp_path, fault(f"type: internal_leakage, at: 18 s, {size}"))
    (leak,) = test.faults
    assert leak.coefficient == pytest.approx(coefficient, rel=1e-12)
    assert (leak.linear, leak.at_s, leak.until_s) == (linear, 18.0, inf)
    assert test.expect == Verdict.INTERNAL_LEAKAGE


def test_a_leak_may_be_sized_by_the_needle_and_opens_as_fast_as_its_ball_valve(
    tmp_path: Path,
) -> None:
    path = tmp_path / "campaign.yaml"
    opening = "type: external_leakage_2, at: 18 s, until: 30 s, ramp: 5 s, needle_opening: 60 %"
    path.write_text(HEAD + TEST + f"    faults: [{{{opening}}}]\n")
    campaign, rig = load_campaign(path)
    (leak,) = campaign.tests[0].faults
    valve = rig.bypass_valves["external_leakage_2"]
    assert leak.coefficient == valve.effective(0.6)
    assert (leak.until_s, leak.ramp_s, leak.travel_s) == (30.0, 5.0, valve.ball_travel_s)


def test_a_return_blockage_is_a_resistance_or_a_pressure_at_a_flow(tmp_path: Path) -> None:
    for size in ("coefficient: 1.8e13 Pa/(m^3/s)^2", "flow: 20 L/min, pressure: 2 MPa"):
        test = only_test(tmp_path, fault(f"type: return_blockage, at: 18 s, {size}"))
        assert test.faults[0].coefficient == pytest.approx(1.8e13)
        assert test.expect == Verdict.RETURN_BLOCKAGE


def test_two_faults_at_once_should_be_found_as_multiple(tmp_path: Path) -> None:
    leak = "at: 18 s, flow: 0.5 L/min, pressure: 6.9 MPa"
    both = f"faults: [{{type: external_leakage_1, {leak}}}, {{type: internal_leakage, {leak}}}]"
    assert only_test(tmp_path, both).expect == Verdict.MULTIPLE
    assert only_test(tmp_path, f"{both}\nexpect: unknown_fault").expect == Verdict.UNKNOWN_FAULT


def test_one_place_may_leak_again_once_it_was_shut(tmp_path: Path) -> None:
    leak = "type: external_leakage_1, flow: 0.5 L/min, pressure: 6.9 MPa"
    again = f"faults: [{{{leak}, at: 9 s, until: 18 s}}, {{{leak}, at: 20 s}}]"
    assert len(only_test(tmp_path, again).faults) == 2


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ("type: leak, at: 1 s, needle_opening: 0.5", "type: leak is not a choice here; choose one"),
        (
            "type: internal_leakage, at: 50 s, needle_opening: 0.5",
            "at: 50 s is beyond the test's 40 s; choose a time within the test",
        ),
        (
            "type: internal_leakage, at: 9 s, until: 50 s, needle_opening: 0.5",
            "until: 50 s is beyond the test's 40 s",
        ),
        ("type: internal_leakage, at: -1 s, needle_opening: 0.5", "at: -1 s is below 0 s"),
        (
            "type: internal_leakage, at: 9 s, until: 8 s, needle_opening: 0.5",
            "until: 8 s is not after at (9 s)",
        ),
        (
            "type: internal_leakage, at: 9 s",
            "internal_leakage: has no size; give one of needle_opening, coefficient, linear",
        ),
        (
            "type: internal_leakage, at: 9 s, needle_opening: 0.5, coefficient: 4e-9 m^3/(s Pa^.5)",
            "internal_leakage: gives needle_opening and coefficient; give one of",
        ),
        (
            "type: internal_leakage, at: 9 s, flow: 0.5 L/min",
            "flow: is given without pressure; add `pressure: 6.9 MPa`",
        ),
        (
            "type: internal_leakage, at: 9 s, coefficient: 4e-9 m^3/(s Pa)",
            "coefficient: 4e-9 m^3/(s Pa) is not a leakage coefficient (square-root law); "
            "for m^3/(s Pa), the linear law, write linear_coefficient",
        ),
        (
            "type: internal_leakage, at: 9 s, coefficient: 5e-8 m^3/(s Pa^0.5)",
            "coefficient: 5e-8 m^3/(s Pa^0.5) is above the 2.599e-08 m^3/(s Pa^0.5) of the cros",
        ),
        (
            "type: internal_leakage, at: 9 s, flow: 5 L/min, pressure: 6.9 MPa",
            "flow: 5 L/min is above the 4.096 L/min at 6.9 MPa of the crossport bypass",
        ),
        (
            "type: internal_leakage, at: 9 s, linear_coefficient: 2e-11 m^3/(s Pa)",
            "linear_coefficient: 2e-11 m^3/(s Pa) is above the 9.893e-12 m^3/(s Pa) of the cr",
        ),
        (
            "type: internal_leakage, at: 9 s, needle_opening: 35",
            "needle_opening: 35 is above 1; did you mean 0.35?",
        ),
        (
            "type: internal_leakage, at: 9 s, needle_opening: 0",
            "needle_opening: 0 is no fault; ask for more, or leave the fault out",
        ),
        (
            "type: supply_leakage, at: 9 s, linear_coefficient: 2e-12 m^3/(s Pa)",
            "linear_coefficient: is no size of a supply leakage; give one of needle_opening, co",
        ),
        (
            "type: return_blockage, at: 9 s, needle_opening: 0.5",
            "needle_opening: is no size of a return blockage; give one of coefficient, flow with",
        ),
        (
            "type: return_blockage, at: 9 s, flow: 2 L/min, pressure: 6 MPa",
            "pressure: 6 MPa is above the 44.44 kPa at 2 L/min of the return throttle of the rig",
        ),
        (
            "type: return_blockage, at: 9 s, flow: 0 L/min, pressure: 6 MPa",
            "pressure: 6 MPa is above the 0 Pa at 0 L/min of the return throttle",
        ),
    ],
)
def test_a_fault_that_cannot_be_injected_says_why(tmp_path: Path, keys: str, problem: str) -> None:
    (found,) = problems_of(tmp_path, fault(keys))
    assert found.split(" ", 1)[1].startswith(problem)
    assert found.startswith("campaign.yaml:8:")


def test_one_place_does_not_leak_twice_at_once(tmp_path: Path) -> None:
    leak = "type: external_leakage_1, needle_opening: 0.5"
    (found,) = problems_of(tmp_path, f"faults: [{{{leak}, at: 9 s}}, {{{leak}, at: 20 s}}]")
    assert "type: external_leakage_1 is there already from 9 s on" in found


def test_a_leak_on_a_rig_without_that_bypass_names_those_it_has(tmp_path: Path) -> None:
    (tmp_path / "bare.yaml").write_text(
        "name: bare\nplant: nominal\n"
        "limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa}\n"
        "bypass_valves: {internal_leakage: {needle: {maximum: 2e-8 m^3/(s Pa^0.5)}}}\n"
    )
    path = tmp_path / "campaign.yaml"
    leaks = ("external_leakage_1", "return_blockage")
    sizes = ("needle_opening: 0.5", "flow: 20 L/min, pressure: 2 MPa")
    faults = "".join(
        f"\n      - {{type: {leak}, at: 9 s, {size}}}"
        for leak, size in zip(leaks, sizes, strict=True)
    )
    path.write_text(HEAD + TEST + f"    faults:{faults}\n")
    with pytest.raises(ConfigError) as caught:
        load_campaign(path, rig_override=tmp_path / "bare.yaml")
    assert [(p.line, p.value, p.limit) for p in caught.value.problems] == [
        (8, "external_leakage_1", "needs a bypass valve that the rig bare lacks"),
        (9, "return_blockage", "needs a valve that the rig bare lacks"),
    ]
    assert "it has: internal_leakage" in caught.value.problems[0].remedy


def test_a_load_is_a_spring_within_the_stroke(tmp_path: Path) -> None:
    test = only_test(tmp_path, "load: {stiffness: 2e4 N/m, contact: 0.22 m}")
    assert test.load == SpringLoad(2e4, 0.22)
    assert only_test(tmp_path, "load: none").load is None
    (found,) = problems_of(tmp_path, "load: {stiffness: 2e4 N/m, contact: 0.7 m}")
    assert "contact: 0.7 m is outside the stroke of 0 m to 0.6069 m" in found


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ("expect: helthy", "expect: helthy is not a choice here; did you mean healthy?"),
        ("start_position: 0.61 m", "start_position: 0.61 m is not within 5 mm to 0.6 m"),
        ("repeats: 0", "repeats: 0 should be greater than or equal to 1"),
        ("seed: -1", "seed: -1 should be greater than or equal to 0"),
        ("faults: internal_leakage", "faults: internal_leakage is not a list; write a list"),
        ("matrix: [1]", "matrix: [1] is not a mapping; write `axis: [values]`"),
        ("matrix: {x: []}", "x: [] has no values; write a list of values"),
        ("matrix: {x: [[1]]}", "x[0]: [1] has no label; write x as a mapping of labels"),
        ("matrix: {x: [1, 2]}", "name: a is given for several tests of the matrix; write every"),
        ("settle: ${x} s\nmatrix: {y: [1]}", "settle: ${x} is no axis of the matrix; axes: y"),
        (
            "settle: ${x} s\nmatrix: {x: {b: [1]}}",
            "settle: ${x} is a structure within a text; let ${x} stand alone",
        ),
    ],
)
def test_a_mistake_in_a_test_is_named_with_its_remedy(
    tmp_path: Path, keys: str, problem: str
) -> None:
    assert problem in problems_of(tmp_path, keys)[0]


def test_a_wrong_value_of_a_matrix_is_reported_once_where_it_stands(tmp_path: Path) -> None:
    keys = (
        "matrix:\n  leak: [external_leakage_1, internal_leakage]\n  flow:\n    low: 0.3 L/min\n"
        "    high: 0.3 L\n"
    )
    faults = fault("type: '${leak}', at: 18 s, flow: '${flow}', pressure: 6.9 MPa")
    path = tmp_path / "campaign.yaml"
    body = "".join(f"    {line}\n" for line in (keys + faults).splitlines())
    path.write_text(HEAD + TEST.replace("name: a", "name: ${leak} ${flow}") + body)
    with pytest.raises(ConfigError) as caught:
        load_campaign(path)
    (problem,) = caught.value.problems
    assert (problem.line, problem.field, problem.value) == (11, "flow", "0.3 L")


# Profiles


def profile(keys: str, *entries: str) -> str:
    listed = "".join(f"      - {{{entry}}}\n" for entry in entries)
    return f"faults:\n  - type: internal_leakage\n    {keys}\n    profile:\n{listed}"


GROWING = profile(
    "pressure: 6.9 MPa",
    "at: 5 s, flow: 0.2 L/min",
    "at: 10 s, flow: 0.4 L/min, ramp: 2 s",
    "at: 20 s, needle_opening: 0.7, until: 30 s",
)


def test_a_profile_is_one_leak_that_changes_its_size_with_an_open_bypass(tmp_path: Path) -> None:
    faults = only_test(tmp_path, GROWING).faults
    assert [(each.at_s, each.until_s, each.goes_on) for each in faults] == [
        (5.0, 10.0, True),
        (10.0, 20.0, True),
        (20.0, 30.0, False),
    ]
    assert [each.follows for each in faults] == [0.0, faults[0].coefficient, faults[1].coefficient]
    assert faults[1].coefficient == pytest.approx(2.0 * faults[0].coefficient)


def test_windows_back_to_back_are_one_bypass_that_stays_open(tmp_path: Path) -> None:
    size = "type: internal_leakage, needle_opening: 0.5"
    keys = f"faults:\n  - {{{size}, at: 5 s, until: 9 s}}\n  - {{{size}, at: 9 s}}\n"
    assert [each.goes_on for each in only_test(tmp_path, keys).faults] == [True, False]


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (profile("at: 3 s", "at: 5 s, needle_opening: 0.5"), "at: 3 s is given beside a profile"),
        (profile("until: 30 s", "at: 5 s, needle_opening: 2"), "needle_opening: 2 is above 1"),
        (profile("until: 30 s", "at: 5 s"), "has no size"),
        (profile("until: 30 s", "needle_opening: 0.5"), "lacks the key at"),
        (profile("until: 30 s", "at: 5 s, size: 0.5"), "size: is not a known key"),
        (
            profile("until: 30 s", "at: 9 s, needle_opening: 0.5", "at: 5 s, needle_opening: 0.6"),
            "at: 5 s is not after the entry before, which begins at 9 s",
        ),
        (
            profile("until: 30 s", "at: 5 s, needle_opening: 0.5, until: 9 s",
                    "at: 9.2 s, needle_opening: 0.6"),
            "comes while the ball valve of the one before shuts, until 9.5 s; begin at 9 s",
        ),
        (
            profile("until: 9 s", "at: 5 s, needle_opening: 0.5", "at: 5.2 s, needle_opening: 1"),
            "begins before the ball valve has opened",
        ),
        ("faults:\n  - {type: internal_leakage, profile: 3}\n", "profile: 3 is not a list"),
        ("faults:\n  - {type: internal_leakage, profile: []}\n", "has no entry"),
    ],
)  # fmt: skip
def test_a_profile_that_no_bypass_can_follow_is_refused(
    tmp_path: Path, keys: str, said: str
) -> None:
    assert said in "\n".join(problems_of(tmp_path, keys))


@pytest.mark.parametrize("second", ["at: 5 s", "at: 4 s"])
def test_entries_of_a_profile_in_a_wrong_order_are_one_problem(tmp_path: Path, second: str) -> None:
    keys = profile("", "at: 5 s, needle_opening: 0.5", f"{second}, needle_opening: 0.6")
    (problem,) = problems_of(tmp_path, keys)
    assert f"{second} is not after the entry before, which begins at 5 s" in problem
    assert problem.endswith("give the entries in the order of their times")
