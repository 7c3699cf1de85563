"""What the live stream shows of a campaign's tests: those that are not run now have an outcome."""

import json
import time
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from estimator.leaks.detection import Decision
from faults.campaign import Campaign, CampaignTest
from rig.configuration.rigs.rig import Rig
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.runner import Observer, run_campaign
from rig.runner.campaign.operator_requests import Desk, Request
from rig.runner.campaign.stopping import StopFlag
from rig.runner.campaign.streamed import StreamedRun
from rig.supervisor.processes.health import trip
from rig.supervisor.processes.streaming import Stream

BEGUN = datetime(2026, 11, 28, 12, 0, 30, tzinfo=UTC)
MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]


class KeptStream(Stream):
    """A stream that keeps which tests have which status, each time that they are sent."""

    def __init__(self) -> None:
        self.statuses: list[dict[str, str]] = []
        self.told: list[Mapping[str, Any]] = []

    def attach(self, board: Board, channels: tuple[str, ...]) -> None:
        pass

    def columns(self, segment: int, channels: tuple[str, ...], test: int) -> None:
        pass

    def send(self, kind: str, content: Mapping[str, Any]) -> None:
        if kind == "campaign":
            self.told.append(content)
            self.statuses.append({test["name"]: test["status"] for test in content["tests"]})

    def close(self) -> None:
        pass


class Asks(Observer):
    """Does something the first time that a test has come to 1 s."""

    def __init__(self, act: Callable[[], object]) -> None:
        self._act = act
        self._done = False

    def test_advances(self, time_s: float, decision: Decision | None) -> None:
        if time_s > 1.0 and not self._done:
            self._done = True
            self._act()


@pytest.fixture
def campaign(make_test: MakeTest, make_campaign: MakeCampaign) -> Campaign:
    return make_campaign(*(make_test(name, duration_s=5.0) for name in ("one", "two", "three")))


def shown(campaign: Campaign, rig: Rig, out: Path, observer: Observer, **more: Any) -> KeptStream:
    """Run a campaign; return what its stream was sent."""
    stream = KeptStream()
    run = StreamedRun(stream, observer, simulated=True, live=False)
    try:
        run_campaign(campaign, rig, out, observer=run, **more)
    finally:
        run.ends()
    return stream


def test_a_run_that_goes_on_tells_at_once_what_was_finished_before(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    class Stops(Observer):
        def test_begins(self, number: int, test: CampaignTest) -> None:
            if test.name == "two":
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        shown(campaign, rig, tmp_path, Stops(), by="Ada")
    resumed = shown(campaign, rig, tmp_path, Observer(), resume=True, by="Bo")
    told = resumed.statuses
    assert told[0] == {"one": told[-1]["one"], "two": "", "three": ""}
    assert set(told[-1].values()) <= {"passed", "failed"}
    assert (resumed.told[0]["resumed"], resumed.told[0]["begun_by"]) == (True, "")


def test_when_a_run_was_begun_is_one_time_for_page_journal_results_and_history(
    tmp_path: Path, rig: Rig, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop = StopFlag()

    def compiles(*given: object) -> None:
        time.sleep(1.05)  # so that what is written after it has another second
        stop.request("Ada")

    monkeypatch.setattr("rig.runner.campaign.campaign_run.compile_for", compiles)
    begun = shown(campaign, rig, tmp_path, Observer(), stop=stop, by="Ada").told[0]
    results = json.loads((tmp_path / "results.json").read_text())
    at = [results["started"], results["history"][0]["at"]]
    assert results["history"][0]["what"] == "begun"
    assert at == [at[0]] * 2
    assert datetime.fromisoformat(at[0]).timestamp() == begun["begun_ns"] // 10**9


def test_a_test_that_is_to_be_skipped_is_reported_as_skipped(
    tmp_path: Path, rig: Rig, campaign: Campaign, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The list of tests is sent anew at every chance, and not after half a second only.
    monkeypatch.setattr("rig.runner.campaign.streamed.CAMPAIGN_S", 0.0)
    desk = Desk()

    def skip() -> None:
        desk.ask(Request.SKIP, "Anna", "", "two")

    told = shown(campaign, rig, tmp_path, Asks(skip), desk=desk).statuses
    assert {"one": told[-1]["one"], "two": "skipped", "three": "running"} in told
    assert told[-1]["two"] == "skipped"


def test_a_pause_is_reported_when_it_is_asked_for_and_when_it_is_taken_back(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    desk = Desk()

    def pause_and_go_on() -> None:
        desk.ask(Request.PAUSE, "Anna")
        desk.ask(Request.RESUME, "Anna")

    told = shown(campaign, rig, tmp_path, Asks(pause_and_go_on), desk=desk).told
    pausing = [content["pausing"] for content in told]
    assert (pausing[0], pausing.count(True) > 0, pausing[-1]) == (False, True, False)
    assert {content["paused_by"] for content in told if content["pausing"]} == {"Anna"}
    assert told[-1]["paused_by"] == ""
    assert (told[-1]["status"], told[-1]["reason"]) == ("ended", "")
    assert told[-1]["exit_code"] in (0, 1)


def homing() -> tuple[KeptStream, StreamedRun]:
    stream = KeptStream()
    run = StreamedRun(stream, Observer(), simulated=False, live=True, activity="homing", by="Bo")
    return stream, run


def test_what_is_no_campaign_is_told_as_its_rig_is_connected_with_who_asked_for_it() -> None:
    stream, run = homing()
    assert stream.told == []
    run.connects(Board.create(2), ("position_m", "command_V"))
    told = stream.told[-1]
    assert (told["name"], told["activity"], told["begun_by"]) == ("homing", "homing", "Bo")
    assert (told["status"], told["tests"]) == ("running", [])
    run.ends()
    assert (stream.told[-1]["status"], stream.told[-1]["exit_code"]) == ("ended", 0)


def test_who_watches_learns_to_whom_a_station_leaves_the_rig() -> None:
    stream, run = homing()
    run.connects(Board.create(2), ("position_m", "command_V"))
    run.hands_over("tuning, asked by Ben")
    assert stream.told[-1]["hands_over"] == "tuning, asked by Ben"


def test_who_watches_learns_what_moves_the_ram_by_hand_and_how_that_ended() -> None:
    stream, run = homing()
    run.connects(Board.create(2), ("position_m", "command_V"))
    run.moves("hold out", "")
    assert (stream.told[-1]["motion"], stream.told[-1]["moved"]) == ("hold out", "")
    run.moves("", "hold out: done")
    assert (stream.told[-1]["motion"], stream.told[-1]["moved"]) == ("", "hold out: done")


def test_who_watches_learns_why_it_ended_early() -> None:
    stream, run = homing()
    run.connects(Board.create(2), ("position_m", "command_V"))
    run.ends("stopped by Ben")
    told = stream.told[-1]
    assert (told["status"], told["exit_code"], told["reason"]) == ("ended", 3, "stopped by Ben")


def test_a_station_tells_what_drove_last_with_its_state_and_is_told_how_that_ended() -> None:
    stream, run = homing()
    board = Board.create(2)
    run.came_before({"ended_ns": 1})
    run.connects(board, ("position_m", "command_V"))
    assert stream.told[-1]["last"] == {"ended_ns": 1}
    run.came_before({"ended_ns": 2})
    assert stream.told[-1]["last"] == {"ended_ns": 2}
    board.words[Word.ROWS] = 1
    trip(board.words, "loop", Cause.ESTOP_OPEN)
    said: list[Mapping[str, Any]] = []
    run.ends("the emergency stop is open", said.append)
    (ended,) = said
    assert ended["campaign"]["reason"] == "the emergency stop is open"
    assert ended["trips"]["first_out"][0]["cause"] == "ESTOP_OPEN"
    assert ended["trips"]["confirmed"]["valve null"] is None


def test_how_a_campaign_ended_is_said_by_the_campaign_alone(
    tmp_path: Path, rig: Rig, campaign: Campaign
) -> None:
    stream = KeptStream()
    run = StreamedRun(stream, Observer(), simulated=True, live=False)
    run.campaign_begins(campaign, tmp_path, [], BEGUN, resumed=False)
    run.campaign_ends(1, "")
    run.ends("a file cannot be read")
    told = stream.told[-1]
    assert (told["status"], told["exit_code"], told["reason"]) == ("ended", 1, "")
    refused = StreamedRun(stream, Observer(), simulated=False, live=True)
    refused.campaign_begins(campaign, tmp_path, [], BEGUN, resumed=False)
    refused.ends("daq: does not answer")
    told = stream.told[-1]
    assert (told["exit_code"], told["reason"]) == (2, "daq: does not answer")


def test_motions_of_an_experiment_have_no_verdict_that_could_be_wrong(
    tmp_path: Path, rig: Rig, make_test: MakeTest, make_campaign: MakeCampaign
) -> None:
    stream = KeptStream()
    run = StreamedRun(stream, Observer(), simulated=True, live=False, activity="tuning", by="Bo")
    motion = make_test("stroke", duration_s=2.0, expect="internal_leakage")
    outcome = run_campaign(make_campaign(motion), rig, tmp_path, observer=run)
    run.ends()
    assert outcome.tests[0].status == "failed"
    (told,) = stream.told[-1]["tests"]
    assert (told["status"], told["verdict"], told["expect"]) == ("passed", "", "")
    assert stream.told[-1]["begun_by"] == "Bo"
