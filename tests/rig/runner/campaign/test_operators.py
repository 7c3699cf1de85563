"""What operators ask of a running campaign: pause, skip, retry, notes; and who may ask."""

import json
import os
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from estimator.leaks.detection import Decision
from faults.campaign import Campaign, CampaignTest, Condition, WhenUnmet
from rig.configuration.rigs.rig import Rig
from rig.control_socket import SOCKET, ControlError, ask
from rig.recording import read_recording
from rig.runner import CampaignOutcome, Observer, Status, run_campaign
from rig.runner.campaign.control_port import ControlPort
from rig.runner.campaign.operator_requests import LONGEST_TEXT, Desk, RefusedError, Request
from rig.runner.campaign.simulated_bench import SimulatedBench
from rig.runner.campaign.stopping import StopFlag
from rig.runner.run_folder.journal import JOURNAL, read_journal

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class Asking(Observer):
    """Asks something of the campaign the first time that a test has come to 1 s."""

    def __init__(self, folder: Path, **requests: tuple[Request, str]) -> None:
        self._folder = folder
        self._requests = requests
        self._test = ""
        self.begun: list[str] = []
        self.answers: list[str] = []

    def test_begins(self, number: int, test: CampaignTest) -> None:
        self._test = test.name
        self.begun.append(test.name)

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        if time_s > 1.0 and self._test in self._requests:
            request, text = self._requests.pop(self._test)
            self.answers.append(ask(self._folder, request, text)["reply"])


@pytest.fixture
def campaign(make_test: MakeTest, make_campaign: MakeCampaign) -> Campaign:
    return make_campaign(*(make_test(name, duration_s=5.0) for name in ("one", "two", "three")))


def statuses(outcome: CampaignOutcome) -> list[str]:
    return [str(test.status) for test in outcome.tests]


def happened(outcome: CampaignOutcome) -> list[str]:
    return [each.what for each in outcome.history]


def test_a_skipped_test_is_ended_kept_and_said_to_be(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, one=(Request.SKIP, "the pump is cold"))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    assert observer.answers == ["ends and skips one"]
    assert outcome.tests[0].status is Status.SKIPPED
    assert outcome.tests[0].recorded_s < 5.0
    assert outcome.exit_code == 1
    assert read_recording(tmp_path / "one.mcap").events[-1].kind == "skipped"
    assert "skip one: the pump is cold" in happened(outcome)
    assert observer.begun == ["one", "two", "three"]


def test_a_test_to_be_retried_is_ended_and_run_again(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, two=(Request.RETRY, ""))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    assert observer.begun == ["one", "two", "two", "three"]
    assert outcome.tests[1].recorded_s == 5.0
    (attempt,) = outcome.tests[1].attempts
    assert attempt.message == "an operator has it run again"
    assert len(read_recording(tmp_path / "two~1.mcap")) < 5000


def test_an_abort_ends_the_campaign_as_ctrl_c_does(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, two=(Request.ABORT, ""))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    assert statuses(outcome)[1:] == ["aborted", "not_run"]
    assert outcome.exit_code == 3


def test_who_stops_a_campaign_while_its_rig_is_made_ready_is_in_its_journal(
    tmp_path: Path, rig: Rig, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    def compiles(*given: object) -> None:
        with pytest.raises(ControlError, match="is not running"):
            ask(tmp_path, Request.PAUSE)
        ask(tmp_path, Request.ABORT, "Ada: it smells", person="Ada")

    monkeypatch.setattr("rig.runner.campaign.campaign_run.compile_for", compiles)
    outcome = run_campaign(campaign, rig, tmp_path)
    assert statuses(outcome) == ["not_run"] * 3
    begin, refused, asked, end = read_journal(tmp_path / JOURNAL)
    kinds = [each.kind for each in (begin, refused, asked, end)]
    assert kinds == ["begin", "refused", "operator", "end"]
    assert (asked["request"], asked["person"]) == ("abort", "Ada")
    assert (end["reason"], end["exit_code"]) == ("Ada: it smells", 3)


def test_a_note_is_in_journal_recording_and_results(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, one=(Request.NOTE, "oil drips from port 1; <b>see photo</b>"))
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    text = "oil drips from port 1; <b>see photo</b>"
    events = read_recording(tmp_path / "one.mcap").events
    assert [e.text.partition(": ")[2] for e in events if e.kind == "note"] == [text]
    assert text in happened(outcome)
    written = json.loads((tmp_path / "results.json").read_text())
    assert text in [each["what"] for each in written["history"]]


def test_a_paused_campaign_waits_after_the_test_and_goes_on_when_resumed(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, one=(Request.PAUSE, ""))
    outcomes: list[CampaignOutcome] = []
    run = threading.Thread(
        target=lambda: outcomes.append(run_campaign(campaign, rig, tmp_path, observer=observer))
    )
    run.start()
    try:
        await_state(tmp_path, "paused")
        assert observer.begun == ["one"]
        assert observer.answers == ["pauses after one; go on with resume"]
        assert ask(tmp_path, Request.SKIP, test="two")["reply"] == "will skip two"
        assert ask(tmp_path, Request.RETRY)["reply"] == "will run one again"
        with pytest.raises(ControlError, match="three has not been run yet"):
            ask(tmp_path, Request.RETRY, test="three")
        with pytest.raises(ControlError, match="no test 'four' in the campaign"):
            ask(tmp_path, Request.SKIP, test="four")
        assert ask(tmp_path, Request.RESUME)["reply"] == "goes on"
    finally:
        run.join(60.0)
    assert observer.begun == ["one", "one", "three"]
    assert outcomes[0].tests[1].status is Status.SKIPPED
    assert outcomes[0].tests[0].attempts


def await_state(folder: Path, state: str) -> None:
    until = time.monotonic() + 60.0
    while time.monotonic() < until:
        try:
            if ask(folder, Request.STATUS)["status"]["state"] == state:
                return
        except ControlError:
            pass
        time.sleep(0.01)
    raise AssertionError(f"never {state}")


def test_what_a_killed_campaign_was_asked_for_holds_when_it_is_resumed(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    class Killed(BaseException):
        pass

    class Dying(Asking):
        def test_advances(self, time_s: float, decision: Decision | None) -> None:
            ask(self._folder, Request.SKIP, test="three")
            raise Killed

    with pytest.raises(Killed):
        run_campaign(campaign, rig, tmp_path, observer=Dying(tmp_path))
    outcome = run_campaign(campaign, rig, tmp_path, resume=True)
    assert outcome.tests[2].status is Status.SKIPPED
    assert Status.NOT_RUN not in {test.status for test in outcome.tests}


def test_acknowledging_names_what_wanted_attention(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    observer = Asking(tmp_path, two=(Request.ACKNOWLEDGE, "seen"))
    # Five seconds are too few for a verdict: every test fails.
    outcome = run_campaign(campaign, rig, tmp_path, observer=observer)
    assert outcome.tests[0].status is Status.FAILED
    assert observer.answers == ["acknowledged: one: failed"]
    assert "acknowledge one: failed: seen" in happened(outcome)


# -- conditions ------------------------------------------------------------------------------------


class Warming(SimulatedBench):
    """A bench whose oil is too warm for a while once the second test runs."""

    def __init__(self, rig: Rig, directory: Path, readings: list[float]) -> None:
        super().__init__(rig, directory)
        self._readings = readings

    def reading(self, channel: str) -> float | None:
        assert channel == "oil_temperature_K"
        return self._readings.pop(0) if len(self._readings) > 1 else self._readings[0]


WARM = Condition("oil_temperature_K", high=330.0, hysteresis=5.0, for_s=0.0)


def conditioned(campaign: Campaign, *conditions: Condition) -> Campaign:
    return replace(campaign, conditions=conditions)


def test_a_precondition_holds_the_campaign_until_it_is_met_with_hysteresis(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    bench = Warming(rig, tmp_path, [340.0, 329.0, 326.0, 324.0])
    outcome = run_campaign(conditioned(campaign, WARM), rig, tmp_path, bench=bench)
    held, released = happened(outcome)
    assert held == "held: oil_temperature_K is 340 K, above 330 K; goes on at 325 K"
    assert released.startswith("goes on after")
    assert Status.NOT_RUN not in {test.status for test in outcome.tests}


def test_a_condition_that_interrupts_has_the_test_run_again_once_it_is_met(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    interrupting = Condition("oil_temperature_K", high=330.0, for_s=0.0, action=WhenUnmet.INTERRUPT)
    bench = Warming(rig, tmp_path, [320.0] * 4 + [340.0] * 2 + [320.0])
    observer = Asking(tmp_path)
    conditional = conditioned(campaign, interrupting)
    outcome = run_campaign(conditional, rig, tmp_path, bench=bench, observer=observer)
    assert observer.begun == ["one", "one", "two", "three"]
    (attempt,) = outcome.tests[0].attempts
    assert attempt.message.startswith("oil_temperature_K is 340 K")
    assert read_recording(tmp_path / "one~1.mcap").events[-1].kind == "interrupted"


def test_a_condition_that_lets_tests_finish_holds_the_next(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    bench = Warming(rig, tmp_path, [320.0] * 4 + [340.0] * 40 + [320.0])
    observer = Asking(tmp_path)
    outcome = run_campaign(
        conditioned(campaign, WARM), rig, tmp_path, bench=bench, observer=observer
    )
    assert observer.begun == ["one", "two", "three"]
    assert not any(test.attempts for test in outcome.tests)
    assert any(what.startswith("held: ") for what in happened(outcome))


def test_what_a_simulated_rig_read_at_its_end_does_not_hold_the_next_one(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    never_met = Condition("position_m", high=0.0, for_s=0.0)
    observer = Asking(tmp_path)
    run_campaign(conditioned(campaign, never_met), rig, tmp_path, observer=observer)
    assert observer.begun == ["one", "two", "three"]


def test_a_condition_that_is_never_met_ends_the_campaign_in_time(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    bench = Warming(rig, tmp_path, [float("nan")])
    never = Condition("oil_temperature_K", high=330.0, give_up_s=0.0)
    outcome = run_campaign(conditioned(campaign, never), rig, tmp_path, bench=bench)
    assert {test.status for test in outcome.tests} == {Status.NOT_RUN}
    assert outcome.exit_code == 3
    assert "held: oil_temperature_K has no reading" in happened(outcome)


# -- who may ask, and how --------------------------------------------------------------------------


@pytest.fixture
def desk() -> Desk:
    desk = Desk()
    desk.open(["one", "two"], {}, lambda kind, **told: None, StopFlag())
    return desk


def test_the_socket_is_for_its_user_alone_and_gone_after_the_run(
    tmp_path: Path, desk: Desk
) -> None:
    with ControlPort(tmp_path, desk, lambda why: None):
        assert (tmp_path / SOCKET).stat().st_mode & 0o777 == 0o600
        assert ask(tmp_path, Request.STATUS)["status"]["tests"] == 2
    assert not (tmp_path / SOCKET).exists()
    with pytest.raises(ControlError, match="no campaign is running in it"):
        ask(tmp_path, Request.PAUSE)


def test_another_user_is_refused_and_that_is_told(
    tmp_path: Path, desk: Desk, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[str] = []
    with ControlPort(tmp_path, desk, refused.append):
        monkeypatch.setattr(os, "getuid", lambda: 4711)
        monkeypatch.setattr("rig.runner.campaign.control_port._ROOT", 4712)
        with pytest.raises(ControlError, match="may not control this campaign"):
            ask(tmp_path, Request.ABORT)
    assert len(refused) == 1


def test_an_operator_without_a_name_or_a_remark_stops_a_campaign() -> None:
    desk, stop = Desk(), StopFlag()
    desk.open(["one"], {}, lambda kind, **told: None, stop)
    assert desk.ask(Request.ABORT, "").startswith("is stopped")
    assert stop.requested


HOSTILE = {
    "not JSON": b"pause\n",
    "a list": b"[1]\n",
    "an unknown request": b'{"request": "format the disk"}\n',
    "an unknown key": b'{"request": "pause", "sudo": "yes"}\n',
    "a number for a text": b'{"request": "note", "text": 7}\n',
    "endless nesting": b"[" * 10_000 + b"\n",
    "oversized": b'{"request": "note", "text": "' + b"x" * 100_000 + b'"}\n',
    "no end": b'{"request": ',
}


@pytest.mark.parametrize("kind", HOSTILE)
def test_a_hostile_request_is_refused_told_and_the_next_one_served(
    tmp_path: Path, desk: Desk, kind: str
) -> None:
    refused: list[str] = []
    with ControlPort(tmp_path, desk, refused.append):
        opened = os.open(tmp_path, os.O_RDONLY)
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(f"/proc/self/fd/{opened}/{SOCKET}")
            try:
                client.sendall(HOSTILE[kind])
                client.shutdown(socket.SHUT_WR)
                answer = client.recv(4096)
            except OSError:  # it is not read to its end
                answer = b""
        os.close(opened)
        assert b'"ok": true' not in answer
        assert ask(tmp_path, Request.PAUSE)["reply"].startswith("pauses")
    assert len(refused) == 1
    assert desk.status()["pausing"]


def test_a_desk_refuses_what_makes_no_sense(desk: Desk) -> None:
    for request, text, why in (
        (Request.RESUME, "", "is not paused"),
        (Request.NOTE, " ", "needs a text"),
        (Request.NOTE, "x" * (LONGEST_TEXT + 1), "at most"),
        (Request.SKIP, "", "no test runs"),
        (Request.RETRY, "", "no test runs"),
    ):
        with pytest.raises(RefusedError, match=why):
            desk.ask(request, "anna", text)
    desk.close()
    with pytest.raises(RefusedError, match="is not running"):
        desk.ask(Request.PAUSE, "anna")


def test_what_was_asked_is_in_the_journal_before_it_is_answered(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    seen: list[bool] = []

    class Looking(Asking):
        def test_advances(self, time_s: float, decision: Decision | None) -> None:
            super().test_advances(time_s, decision)
            kinds = [entry.kind for entry in read_journal(tmp_path / JOURNAL)]
            seen.append("operator" in kinds)

    run_campaign(campaign, rig, tmp_path, observer=Looking(tmp_path, one=(Request.NOTE, "now")))
    assert seen[-1]
