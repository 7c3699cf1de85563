"""A check warns of a control that is unstable by the model, or worse than its gain alone."""

from pathlib import Path

import pytest

from rig.configuration.checking import check

SLOW = "{type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.2 Hz}"
FAST = "{type: sine, mean: 0.3 m, amplitude: 0.15 m, frequency: 0.5 Hz}"


def warnings_of(folder: Path, *tests: str, setpoint: str = SLOW) -> tuple[str, ...]:
    """Return the warnings of a check of tests of 5 s, given their other keys."""
    path = folder / "campaign.yaml"
    written = "".join(
        f"  - {{name: t{number}, duration: 5 s, setpoint: {setpoint}, {keys}}}\n"
        for number, keys in enumerate(tests, start=1)
    )
    path.write_text(f"name: c\nrig: simulated\ntests:\n{written}")
    return check(path).warnings


@pytest.mark.parametrize("keys", ["position_gain: 9000 V/m", "control: {gain: 9 V/mm}"])
def test_a_gain_that_leaves_no_margin_is_warned_of_with_the_greatest_that_does(
    tmp_path: Path, keys: str
) -> None:
    (warning,) = warnings_of(tmp_path, keys)
    assert warning.startswith("t1: the control leaves no margin at all by the model at 9000 V/m")
    greatest = warning.split("the greatest gain that keeps them is about ")[1].removesuffix(" V/m")
    assert not warnings_of(tmp_path, f"position_gain: {float(greatest):g} V/m")
    (slightly_more,) = warnings_of(tmp_path, f"position_gain: {1.1 * float(greatest):g} V/m")
    assert "below the 6 dB and 30 degrees" in slightly_more


def test_an_integral_that_no_gain_can_bear_has_another_remedy(tmp_path: Path) -> None:
    hot = "control: {gain: 5 V/mm, feedforward: model, integral_time: 10 ms}"
    (warning,) = warnings_of(tmp_path, hot)
    assert warning.endswith("give it a longer integral_time, or less deadband")


def test_tests_of_the_same_control_are_warned_of_once(tmp_path: Path) -> None:
    hot, other = "position_gain: 9000 V/m", "position_gain: 8000 V/m"
    found = warnings_of(tmp_path, hot, hot, other, hot)
    assert [each.split(":")[0] for each in found] == ["t1", "t3"]


def test_the_usual_gain_and_the_tracking_law_are_warned_of_nothing(tmp_path: Path) -> None:
    tracking = "control: {feedforward: model, integral_time: 1 s, cyclic: true}"
    integral = "control: {integral_time: 1 s}"
    measured = "control: {null: 0.3 V, deadband: 0.2 V}"
    assert not warnings_of(tmp_path, "expect: healthy", tracking, integral, measured)


@pytest.mark.parametrize("setpoint", [SLOW, FAST])
def test_a_feedforward_of_ten_times_the_right_one_is_warned_of(
    tmp_path: Path, setpoint: str
) -> None:
    (warning,) = warnings_of(tmp_path, "control: {feedforward_gain: 140 V s/m}", setpoint=setpoint)
    assert warning.startswith("t1: the control is expected to let the ram be off by 1")
    assert "beyond the ends of its motion), its gain of 50 V/m alone by" in warning
    assert not warnings_of(tmp_path, "control: {feedforward_gain: 14.0 V s/m}", setpoint=setpoint)


def test_a_change_of_control_is_warned_of_from_its_time(tmp_path: Path) -> None:
    (warning,) = warnings_of(
        tmp_path, "control_changes: [{at: 1 s, control: {feedforward_gain: 140 V s/m}}]"
    )
    assert warning.startswith("t1: the control from 1 s is expected to let the ram be off by")


def test_a_change_that_holds_for_less_than_a_tick_is_no_motion_to_look_at(tmp_path: Path) -> None:
    ahead = "{at: 1 s, control: {feedforward: model}}"
    short = "{at: 1.0001 s, control: {integral_time: 1 s}}"
    late = "{at: 4.9999 s, control: {cyclic: true}}"
    assert not warnings_of(tmp_path, f"control_changes: [{ahead}, {short}, {late}]")
