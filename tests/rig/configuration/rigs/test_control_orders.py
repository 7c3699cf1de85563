"""What an operator orders of a running test's control, in the words of a section `control`."""

import pytest

from control import ControlSettings
from rig.configuration import ConfigError, control_in_words, ordered_control

NOW = ControlSettings(gain=50.0, integral_time=1.0, cyclic=True)


def test_an_order_changes_the_keys_that_it_names() -> None:
    found = ordered_control("gain=80V/m, hold_band = 0.5 mm", NOW)
    assert found == ControlSettings(gain=80.0, integral_time=1.0, cyclic=True, hold_band=5e-4)
    words = "gain 50 V/m -> 80 V/m, hold_band none -> 0.5 mm"
    assert control_in_words(found, NOW) == words
    assert control_in_words(NOW) == "gain 50 V/m, integral_time 1 s, cyclic true"


def test_a_key_that_may_be_left_out_is_taken_back_by_none() -> None:
    assert ordered_control("integral_time=none", NOW).integral_time is None
    assert ordered_control("feedforward=none", NOW).feedforward == "none"


def test_one_word_asks_for_the_loop_of_the_thesis_with_the_present_gain() -> None:
    assert ordered_control("proportional", NOW) == ControlSettings(gain=50.0)


@pytest.mark.parametrize(
    ("order", "why"),
    [
        ("", "names no key"),
        ("gain", "gain is not of the form KEY=VALUE"),
        ("gan=80 V/m", "did you mean gain"),
        ("gain=80", "80 has no unit"),
        ("gain=80 V", "80 V is not a position gain"),
        ("gain=1e9 V/m", "is above 10000 V/m"),
        ("null=none", "none is not a quantity"),
        ("cyclic=perhaps", "perhaps should be a valid boolean"),
        ("gain=80 V/m, gain=70 V/m", "70 V/m is given twice"),
        ("feedforward=model, feedforward_gain=14 V s/m", "although the feedforward is that of the"),
        ("gain=80 V/m,", "is not of the form KEY=VALUE"),
    ],
)
def test_an_order_that_cannot_be_used_is_refused(order: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        ordered_control(order, NOW)


@pytest.mark.parametrize(
    "value",
    ["0x" + "f" * 5000, "9" * 5000, "1" + ":1" * 5000, "2026-13-45", "[" * 5000, "1e99999"],
    ids=["hexadecimal", "decimal", "sixties", "no day", "nested", "exponent"],
)
@pytest.mark.parametrize("key", ["gain", "cyclic", "feedforward"])
def test_what_no_value_can_be_is_refused_in_a_line(key: str, value: str) -> None:
    with pytest.raises(ConfigError) as caught:
        ordered_control(f"{key}={value}", NOW)
    (problem,) = caught.value.problems
    assert len(str(problem)) < 400


def test_all_that_is_wrong_is_told_at_once() -> None:
    with pytest.raises(ConfigError) as caught:
        ordered_control("gan=3, integral_time=5, null=7 V, x", NOW)
    assert len(caught.value.problems) == 4
