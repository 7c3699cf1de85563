"""Cycles, segments and loops of a campaign file; what contradicts itself is refused."""

from pathlib import Path

import numpy as np
import pytest

from control import Sequence
from rig.configuration import ConfigError
from tests.rig.configuration.campaigns.written import HEAD, load

SINE = "{type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}"
STEPS = "{type: steps, levels: [0.3 m, 0.4 m], hold: 3 s}"


def with_tests(*lines: str) -> str:
    return HEAD + "tests:\n" + "".join(f"  - {line}\n" for line in lines)


def problems(folder: Path, *lines: str) -> str:
    with pytest.raises(ConfigError) as caught:
        load(folder, with_tests(*lines))
    return str(caught.value).replace(f"{folder}/", "")


def test_cycles_take_the_place_of_a_duration(tmp_path: Path) -> None:
    (test,) = load(tmp_path, with_tests(f"{{name: a, setpoint: {SINE}, cycles: 20}}")).tests
    assert test.duration_s == 40.0


def test_own_cycles_leave_a_default_duration_out(tmp_path: Path) -> None:
    text = with_tests(f"{{name: a, setpoint: {SINE}, cycles: 20}}")
    text = text.replace("tests:", "defaults: {duration: 9 s}\ntests:")
    assert load(tmp_path, text).tests[0].duration_s == 40.0


def test_segments_follow_each_other_and_a_hold_stays_where_the_last_one_ended(
    tmp_path: Path,
) -> None:
    segments = (
        f"[{{name: cycling, setpoint: {SINE}, cycles: 5}}, "
        f"{{loop: 2, segments: [{{setpoint: {STEPS}, duration: 6 s, blend: 1 s}}, {{hold: 2 s}}]}}]"
    )
    (test,) = load(tmp_path, with_tests(f"{{name: a, segments: {segments}}}")).tests
    assert isinstance(test.setpoint, Sequence)
    assert [each.total_s for each in test.setpoint.stretches] == [10.0, 7.0, 2.0, 7.0, 2.0]
    assert test.duration_s == 28.0
    assert test.setpoint.sample(np.array([18.0, 27.5])).tolist() == [0.4, 0.4]
    assert test.start_position_m == 0.3


def test_a_loop_of_tests_runs_them_in_turn_each_with_a_seed_of_its_own(tmp_path: Path) -> None:
    a, b = (f"{{name: {name}, setpoint: {SINE}, cycles: 5}}" for name in "ab")
    tests = load(tmp_path, with_tests(f"{{loop: 2, tests: [{a}, {b}]}}")).tests
    assert [test.name for test in tests] == ["a #1", "b #1", "a #2", "b #2"]
    assert tests[2].seed == tests[0].seed + 1


def test_a_test_may_have_a_gain_of_its_own(tmp_path: Path) -> None:
    line = f"{{name: a, setpoint: {SINE}, cycles: 5, position_gain: 60 V/m}}"
    assert load(tmp_path, with_tests(line)).tests[0].gain_V_per_m == 60.0


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (f"setpoint: {SINE}, cycles: 1.5", "3:", ),
        (f"setpoint: {SINE}, cycles: 0", "should be greater than or equal to 1"),
        (f"setpoint: {SINE}, cycles: 20, duration: 40 s", "give one of both"),
        (f"setpoint: {SINE}, cycles: 2", "2 last 4 s, and a test lasts 5 s to 3600 s"),
        (f"setpoint: {STEPS}, cycles: 20", "which does not repeat itself"),
        (f"setpoint: {SINE}", "lacks the key duration"),
        (f"setpoint: {SINE}, durations: 40 s", "did you mean duration?"),
        ("duration: 40 s", "lacks the key setpoint"),
        ("segments: []", "is empty; give at least one segment"),
        ("segments: {a: 1}", "is not a list"),
        ("segments: [{hold: 9 s}]", "has nothing to hold at the begin of a test"),
        (f"segments: [{{hold: 9 s}}], setpoint: {SINE}", "is given with segments"),
        (f"segments: [{{setpoint: {SINE}}}]", "has no end; give it a duration, or cycles"),
        ("segments: [{duration: 9 s}]", "has no motion; give it a setpoint"),
        (f"segments: [{{setpoint: {SINE}, cycles: 5, blend: 1 s}}]", "has no segment before it"),
        (
            f"segments: [{{setpoint: {SINE}, cycles: 5}}, {{hold: 3 s, blend: 1 s}}]",
            "is given with hold",
        ),
        (
            "segments: [{setpoint: {type: constant, value: 0.2 m}, duration: 5 s}, "
            "{setpoint: {type: constant, value: 0.3 m}, duration: 5 s}]",
            "segment 2 begins +0.1 m from where the one before ends; give it `blend: 2 s`",
        ),
        (
            "segments: [{setpoint: {type: constant, value: 0.2 m}, duration: 5 s}, "
            "{setpoint: {type: constant, value: 1 V}, duration: 5 s}]",
            "is of another quantity",
        ),
        ("segments: [{loop: 0, segments: []}]", "should be greater than or equal to 1"),
        ("segments: [{loop: 3}]", "lacks the key segments"),
        ("segments: [{loop: 999, segments: [{loop: 9, segments: [{hold: 1 s}]}]}], "
         "start_position: 0.3 m", "makes more than 1000 segments"),
        ("segments: [{hold: 1 s}], start_position: 0.3 m", "1 s is not within 5 s to 3600 s"),
        (f"segments: [{{setpoint: {SINE}, cycles: 5, speed: 3}}]", "speed: is not a known key"),
        ("setpoint: {type: constant, value: 0 V}, duration: 9 s, position_gain: 50 V/m",
         "needs a position loop"),
        (f"setpoint: {SINE}, cycles: 5, position_gain: 5 mm", "write a position gain"),
        ("setpoint: {type: trapezoid, amplitude: 0.1 m, mean: 0.3 m, frequency: 0.5 Hz, hold: 1 s},"
         " duration: 9 s", "hold: 1 s leaves no time to move in half a period of 1 s"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_refused_at_its_line(tmp_path: Path, keys: str, said: str) -> None:
    found = problems(tmp_path, f"{{name: a, {keys}}}")
    assert found.startswith("campaign.yaml:4:")
    if said != "3:":
        assert said in found


def test_a_gain_that_is_given_twice_is_told_beside_another_mistake(tmp_path: Path) -> None:
    keys = "duration: 9 s, position_gain: 60 V/m, control: {gain: 80 V/m}, repeats: 2"
    wave = "setpoint: {type: triangle, amplitude: 0.1 m, mean: 0.3 m, frequency: FREQUENCY}"
    for frequency in ("0.5 Hz", "0.5 Hx"):
        found = problems(tmp_path, f"{{name: a, {wave.replace('FREQUENCY', frequency)}, {keys}}}")
        assert found.count("position_gain: 60 V/m is given beside a gain under control") == 1
        assert ("unknown unit 'Hx'" in found) == (frequency == "0.5 Hx")


def test_a_loop_of_tests_needs_tests(tmp_path: Path) -> None:
    assert "lacks the key tests" in problems(tmp_path, "{loop: 2}")
    assert "should be less than or equal to 1000" in problems(tmp_path, "{loop: 2000, tests: []}")
