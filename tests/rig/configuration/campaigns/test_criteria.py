"""Criteria, own figures and limits of a test; what contradicts itself is refused."""

from math import inf
from pathlib import Path

import pytest

from faults import Criterion, TestLimit
from tests.rig.configuration.campaigns.written import only_test, problems_of

FIGURES = """\
figures:
  lag: {expression: "max(abs(setpoint_m - position_m))", unit: m}
  pushing: {expression: "pressure_1_Pa - pressure_2_Pa", unit: Pa}
"""


def criterion(keys: str) -> str:
    return f"{FIGURES}criteria:\n  - {{{keys}}}\n"


def limit(keys: str) -> str:
    return f"{FIGURES}limits:\n  - {{{keys}}}\n"


def test_criteria_are_read_in_the_unit_of_their_figure(tmp_path: Path) -> None:
    keys = f"""{FIGURES}criteria:
  - {{figure: rms_error, at_most: 3 mm, from_time: 5 s}}
  - {{figure: peak, channel: pressure_1_Pa, at_most: 12 MPa}}
  - {{figure: overshoot, at_most: 5 %}}
  - {{figure: leak, at_least: 0.3 L/min, at_most: 0.6 L/min}}
  - {{figure: lag, at_most: 5 mm}}
"""
    test = only_test(tmp_path, keys)
    assert test.criteria[0] == Criterion("rms_error", -inf, 3e-3, "m", from_s=5.0)
    assert [each.label for each in test.criteria[:2]] == [
        "rms_error from 5 s",
        "peak of pressure_1_Pa",
    ]
    assert [each.high for each in test.criteria[1:3]] == [12e6, 0.05]
    assert test.criteria[3].low == pytest.approx(5e-6)
    assert test.criteria[4].unit == "m"


def test_a_limit_has_an_inner_and_an_outer_band(tmp_path: Path) -> None:
    keys = "channel: following_error_m, inner_high: 3 mm, high: 5 mm, for: 20 ms, action: ramp_down"
    (read,) = only_test(tmp_path, limit(keys)).limits
    assert read == TestLimit(
        "following_error_m", "m", high=5e-3, inner_high=3e-3, action="ramp_down", for_s=0.02
    )


def test_a_limit_of_a_figure_looks_back_ten_seconds_unless_it_says_otherwise(
    tmp_path: Path,
) -> None:
    (read,) = only_test(tmp_path, limit("figure: lag, high: 5 mm, action: hold")).limits
    assert (read.over_s, read.action) == (10.0, "hold")
    (read,) = only_test(tmp_path, limit("figure: pushing, low: -9 MPa, action: warn")).limits
    assert (read.over_s, read.unit) == (0.0, "Pa")


@pytest.mark.parametrize(
    ("keys", "watched", "unit", "over_s"),
    [
        ("figure: rms_error, high: 5 mm", "rms_error", "m", 10.0),
        ("figure: peak_error, high: 5 mm, over: 2 s", "peak_error", "m", 2.0),
        ("figure: peak, channel: load_N, high: 5 kN", "peak of load_N", "N", 10.0),
        ("figure: valley, low: 0.1 m", "valley of position_m", "m", 10.0),
        ("figure: residual_pressure_1, high: 50 kPa", "residual_pressure_1", "Pa", 10.0),
        ("figure: bulk_modulus, low: 0.5e9 Pa", "bulk_modulus", "Pa", 0.0),
        ("figure: leak, high: 0.5 L/min", "leak", "m^3/s", 0.0),
    ],
)
def test_a_limit_may_watch_figures_that_every_test_has(
    tmp_path: Path, keys: str, watched: str, unit: str, over_s: float
) -> None:
    (read,) = only_test(tmp_path, limit(keys)).limits
    assert (read.watched, read.unit, read.over_s) == (watched, unit, over_s)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (criterion("figure: rms_eror, at_most: 3 mm"), "did you mean rms_error?"),
        (criterion("figure: rms_error"), "has no limit"),
        (criterion("figure: rms_error, at_most: 3 V"), "is not a length"),
        (criterion("figure: rms_error, at_most: 3"), "has no unit"),
        (criterion("figure: rms_error, at_least: 5 mm, at_most: 3 mm"), "is above at_most"),
        (criterion("figure: rms_error, most: 3 mm"), "most: is not a known key"),
        (criterion("figure: lag, channel: load_N, at_most: 3 mm"), "of no channel"),
        (criterion("figure: peak, channel: lod_N, at_most: 3 N"), "did you mean load_N?"),
        (criterion("figure: pushing, at_most: 3 Pa"), "has a value at each sample"),
        (criterion("figure: leak, at_most: 1 L/min, from_time: 5 s"), "of the whole test"),
        (criterion("figure: lag, at_most: 5 mm, from_time: 50 s"), "leaves nothing of the test's"),
        (criterion("figure: lag, at_most: 5 mm, during: steps"), "is no segment of this test"),
        (
            criterion("figure: lag, at_most: 5 mm, during: steps, from_time: 5 s"),
            "is given with from_time",
        ),
        ("criteria: 3", "criteria: 3 is not a list"),
        ("criteria: [3]", "is not a mapping"),
        ("figures: [a]", "figures: [a] is not a mapping"),
        ("figures: {peak: {expression: max(load_N), unit: N}}", "has a meaning already"),
        ("figures: {a: {expression: max(load_N), unit: kN}}", "unit: kN is no SI unit"),
        ("figures: {a: {expression: max(lod_N), unit: N}}", "did you mean load_N?"),
        ("figures: {a: {expression: 3 + 4}}", "uses no channel"),
        ("figures: {a: {expression: open(load_N)}}", "calls open, which is not known"),
        ("figures: {a: {unit: N}}", "lacks the key expression"),
        ("figures: {a: {expression: max(load_N), units: N}}", "did you mean unit?"),
        (limit("channel: position_m"), "has no limit"),
        (limit("high: 5 mm"), "names nothing to watch"),
        (limit("channel: position_m, figure: lag, high: 5 mm"), "both a channel and a figure"),
        (limit("channel: oil_temperature_K, high: 330 K"), "is not measured by this rig"),
        (limit("channel: position_m, high: 5 V"), "is not a length"),
        (limit("channel: position_m, high: 0.5 m, action: stop"), "choose one of warn, hold"),
        (limit("channel: position_m, low: 0.5 m, high: 0.2 m"), "swap them"),
        (limit("channel: position_m, inner_high: 0.6 m, high: 0.5 m"), "narrower"),
        (limit("channel: position_m, inner_high: 0.6 m"), "add the outer one"),
        (limit("channel: position_m, high: 0.5 m, for: 900 s"), "for: 900 s is above 600 s"),
        (limit("channel: position_m, high: 0.5 m, over: 5 s"), "is for figures"),
        (limit("channel: position_m, low: 0.1 m, high: 0.5 m, hysteresis: 0.3 m"), "reduce it"),
        (limit("figure: settling, high: 5 s"), "can never act: the test has no step"),
        (limit("figure: rms_error, high: 5 V"), "is not a length"),
        (limit("figure: peak, channel: lod_N, high: 5 N"), "did you mean load_N?"),
        (limit("figure: leak, high: 1 L/min, over: 5 s"), "is for figures"),
        (limit("channel: position_m, high: 0.5 m, during: steps"), "is no segment of this test"),
        (limit("figure: lag, high: 5 mm, over: 5 min"), "over: 5 min is above 1 min"),
        (limit("channel: position_m, high: 0.5 m, upto: 3"), "upto: is not a known key"),
        ("limits: 3", "limits: 3 is not a list"),
        ("limits: [3]", "is not a mapping"),
    ],
)
def test_what_is_wrong_is_refused_at_its_line(tmp_path: Path, keys: str, said: str) -> None:
    found = "\n".join(problems_of(tmp_path, keys))
    assert said in found
    assert found.startswith("campaign.yaml:")


def test_an_open_loop_has_no_following_error(tmp_path: Path) -> None:
    volts = "{type: sine, amplitude: 1 V, frequency: 0.5 Hz}"
    for keys in (
        "criteria: [{figure: rms_error, at_most: 3 mm}]",
        "limits: [{channel: following_error_m, high: 3 mm}]",
    ):
        assert "has none" in "\n".join(problems_of(tmp_path, keys, volts))
