"""An operator changes the control of a test that runs; what comes of it is recorded, or refused."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control import ControlSettings, Sine, Steps
from estimator.leaks.detection import Decision
from faults.campaign import Campaign, CampaignTest, ControlFrom
from rig.configuration.rigs.rig import Rig
from rig.control_socket import ControlError, ask
from rig.plant import Model
from rig.recording import read_recording
from rig.report.wording import story
from rig.runner import Observer, run_campaign
from rig.runner.campaign.control_change import RunningControl
from rig.runner.campaign.operator_requests import Desk, RefusedError, Request
from rig.runner.campaign.stopping import StopFlag

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]
SWINGING = Sine(0.3, 0.1, 0.5)


class Setting(Observer):
    """Sets the control of the running test each time that it has come to another time."""

    def __init__(self, folder: Path, orders: dict[float, str]) -> None:
        self._folder = folder
        self._orders = dict(orders)
        self.answers: list[str] = []

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        for at_s in [each for each in self._orders if time_s >= each]:
            try:
                self.answers.append(ask(self._folder, Request.SET, self._orders.pop(at_s))["reply"])
            except ControlError as error:
                self.answers.append(str(error))


def test_a_change_is_taken_without_a_bump_and_recorded_with_who_when_and_what(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(make_test("one", duration_s=3.0, setpoint=SWINGING))
    run_campaign(campaign, rig, tmp_path / "plain")
    orders = {0.4: "gain=80 V/m, feedforward=model", 1.0: "gan=3", 1.4: "proportional"}
    observer = Setting(tmp_path / "set", orders)
    outcome = run_campaign(campaign, rig, tmp_path / "set", observer=observer)

    done, refused, back = observer.answers
    assert done.startswith("sets gain 50 V/m -> 80 V/m, feedforward none -> model in one without")
    assert "set gan: is not a known key; did you mean gain?" in refused
    assert back.startswith("sets feedforward model -> none in one")
    first, second = outcome.tests[0].control_changes
    assert first.what == "gain 50 V/m -> 80 V/m, feedforward none -> model"
    assert first.at_s == pytest.approx(0.501)

    before, changed = (read_recording(tmp_path / each / "one.mcap") for each in ("plain", "set"))
    events = [each for each in changed.events if each.kind == "control"]
    assert [each.time_s for each in events] == [first.at_s, second.at_s]
    assert events[0].text == f"{first.who}: {first.what}"
    at = round(first.at_s / 1e-3)
    commands = [np.asarray(each.channels["command_V"]) for each in (before, changed)]
    assert np.array_equal(commands[0][:at], commands[1][:at])
    assert commands[1][at] == pytest.approx(commands[0][at], abs=1e-9)
    assert abs(commands[1][at + 200] - commands[0][at + 200]) > 0.1

    told = [(each.who, each.what) for each in outcome.history]
    assert (first.who, f"control of one from 0.501 s: {first.what}") in told
    assert f"Control changed from 0.501 s by {first.who}: {first.what}" in story(outcome.tests[0])
    written = json.loads((tmp_path / "set" / "results.json").read_text())
    assert written["tests"][0]["control_changes"][0]["what"] == first.what


def test_a_file_s_changes_hold_from_their_ticks_whatever_an_operator_has_set(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    changes = (
        ControlFrom(1.2345, ControlSettings(gain=80.0)),
        ControlFrom(1.9, ControlSettings(feedforward="model")),
    )
    test = make_test("one", duration_s=2.5, setpoint=SWINGING, control_changes=changes)
    observer = Setting(tmp_path, {0.4: "integral_time=1 s"})
    outcome = run_campaign(make_campaign(test), rig, tmp_path, observer=observer)
    found = outcome.tests[0].control_changes
    assert [each.at_s for each in found] == pytest.approx([0.501, 1.235, 1.9])
    assert [each.who for each in found[1:]] == ["campaign", "campaign"]
    assert [each.what for each in found[1:]] == [
        "gain 50 V/m -> 80 V/m, integral_time 1 s -> none",
        "gain 80 V/m -> 50 V/m, feedforward none -> model",
    ]


def test_a_change_that_comes_when_the_test_has_ended_is_told_as_not_made(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    campaign = make_campaign(make_test("one", duration_s=1.0, setpoint=SWINGING))
    observer = Setting(tmp_path, {0.9: "gain=80 V/m"})
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    assert not outcome.tests[0].control_changes
    told = "control of one was not changed, as it ended: gain 50 V/m -> 80 V/m"
    assert told in [each.what for each in outcome.history]


def control_of(rig: Rig, test: CampaignTest) -> RunningControl:
    return RunningControl(rig, test, Model())


def test_a_change_says_which_margins_the_model_expects(rig: Rig, make_test: MakeTest) -> None:
    control = control_of(rig, make_test(setpoint=SWINGING))
    change, judged = control.asked("anna", "gain=80 V/m")
    assert str(change) == "gain 50 V/m -> 80 V/m"
    assert judged.startswith("by the model it leaves 2")
    assert judged.endswith("; expected following error at most 51.8 mm")


@pytest.mark.parametrize("first", [ControlSettings(), ControlSettings(feedforward_gain=14.0)])
def test_a_feedforward_of_ten_times_the_right_one_is_refused(
    rig: Rig, make_test: MakeTest, first: ControlSettings
) -> None:
    control = control_of(rig, make_test(setpoint=SWINGING, duration_s=5.0, control=first))
    both = r"be off by 1\d\d mm .*; the present control by [\d.]+ mm, the gain alone by 7\d"
    with pytest.raises(RefusedError, match=both):
        control.asked("anna", "feedforward_gain=140 V s/m")
    assert not control.take(0.0)
    assert "at most" in control.asked("anna", "feedforward_gain=13 V s/m")[1]


def test_the_way_back_to_the_gain_alone_is_open_though_it_follows_worse(
    rig: Rig, make_test: MakeTest
) -> None:
    tracking = ControlSettings(feedforward="model", integral_time=1.0)
    control = control_of(rig, make_test(setpoint=SWINGING, duration_s=5.0, control=tracking))
    _, judged = control.asked("anna", "proportional")
    assert judged.endswith("expected following error at most 70.5 mm")


@pytest.mark.parametrize("order", ["null=0.5 V", "deadband=1 V", "integral_time=1 s"])
def test_what_is_measured_on_the_rig_may_differ_from_the_model(
    rig: Rig, make_test: MakeTest, order: str
) -> None:
    hold = make_test(setpoint=Sine(0.3, 1e-4, 0.5), duration_s=5.0)
    assert "following error" in control_of(rig, hold).asked("anna", order)[1]


def test_the_error_is_foreseen_for_the_time_that_comes(rig: Rig, make_test: MakeTest) -> None:
    rests_later = Steps((0.2, 0.3), 2.0)
    control = control_of(rig, make_test(setpoint=rests_later, duration_s=60.0))
    assert float(control.asked("anna", "gain=80 V/m")[1].split()[-2]) > 90.0
    control.take(39.0)
    assert float(control.asked("anna", "gain=80 V/m")[1].split()[-2]) < 1.0


def test_a_run_warns_of_a_control_that_is_unstable_by_the_model(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    told: list[str] = []

    class Told(Observer):
        def rig_tells(self, text: str) -> None:
            told.append(text)

    hot = make_test("hot", duration_s=0.5, setpoint=SWINGING, gain_V_per_m=9000.0)
    calm = make_test("calm", duration_s=0.5, setpoint=SWINGING)
    run_campaign(make_campaign(hot, calm), rig, tmp_path, observer=Told())
    (warning,) = [text for text in told if text.startswith("warning: ")]
    assert warning.startswith("warning: hot: the control leaves no margin at all by the model")


@pytest.mark.parametrize(
    ("order", "remedy"),
    [
        ("gain=2000 V/m", "the greatest gain that keeps them is about"),
        ("integral_time=10 ms", "give it a longer integral_time"),
    ],
)
def test_a_change_that_leaves_too_little_margin_by_the_model_is_refused(
    rig: Rig, make_test: MakeTest, order: str, remedy: str
) -> None:
    control = control_of(rig, make_test(setpoint=SWINGING))
    with pytest.raises(RefusedError, match=f"below the 6 dB and 30 degrees.*{remedy}"):
        control.asked("anna", order)
    assert not control.take(0.0)


def test_a_loop_that_has_too_little_margin_already_may_be_made_calmer(
    rig: Rig, make_test: MakeTest
) -> None:
    hot = make_test(setpoint=SWINGING, control=ControlSettings(gain=3000.0))
    _, judged = control_of(rig, hot).asked("anna", "gain=1500 V/m")
    assert "too little, but more than before" in judged


def test_changes_that_wait_follow_from_each_other(rig: Rig, make_test: MakeTest) -> None:
    control = control_of(rig, make_test(setpoint=SWINGING, gain_V_per_m=60.0))
    for order in ("gain=80 V/m", "integral_time=1 s", "gain=none"):
        control.add(control.asked("anna", order)[0])
    assert [str(each) for each in control.take(0.0)] == [
        "gain 60 V/m -> 80 V/m", "integral_time none -> 1 s", "gain 80 V/m -> 50 V/m",
    ]  # fmt: skip
    assert not control.take(0.0)


def test_what_changes_nothing_or_has_no_position_loop_is_refused(
    rig: Rig, make_test: MakeTest
) -> None:
    with pytest.raises(RefusedError, match="has these values already"):
        control_of(rig, make_test(setpoint=SWINGING)).asked("anna", "gain=50 V/m")
    opened = make_test(setpoint=replace(SWINGING, quantity="command"))
    with pytest.raises(RefusedError, match="is the valve command"):
        control_of(rig, opened).asked("anna", "gain=80 V/m")


def test_between_two_tests_there_is_no_control_to_change() -> None:
    desk = Desk()
    desk.open(["one"], {}, lambda kind, **told: None, StopFlag())
    with pytest.raises(RefusedError, match="no test runs whose control could be set"):
        desk.ask(Request.SET, "anna", "gain=80 V/m")
