"""A stop goes every way there is; nothing is started on a rig that runs."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.console.launcher import ASKED, ENDING, INTERRUPTED, Launcher, Offer, Served
from rig.console.orders import REASONS, MalformedError, Order, Orders, parse
from rig.console.visitors import ControlHolder, Visitor
from rig.stream.answers import Answer
from rig.stream.commands import OTHER_SESSION

from .fakes import RUNNING, FakeClient, until

ANNA = Visitor(1, "Anna", 9e9)


class FakeLauncher(Launcher):
    """A launcher that says how it stops what runs, and keeps what it is asked."""

    def __init__(self, folder: Path, stops: str = "") -> None:
        offers = (Offer("a", "a", "", "bench", 1), Offer("b", "b", "", "other", 1))
        super().__init__(Served(offers, folder, "loopback"), lambda text: None)
        self.stops = stops
        self.asked: list[str] = []

    def stop(self, said: str, by: str = "") -> str:
        self.asked.append(f"stop: {said}")
        return self.stops

    def start(self, name: str, by: str) -> None:
        self.asked.append(f"start {name} by {by}")

    def go_on(self, name: str, by: str) -> None:
        self.asked.append(f"go on {name} by {by}")

    def acknowledge(self, name: str, text: str, by: str) -> None:
        self.asked.append(f"acknowledge {name} by {by}: {text}")


class Connecting(FakeClient):
    """The client of a rig that answers nobody before it has been asked so many times."""

    def __init__(self, unanswered: int, reason: str = "no answer: nobody is there") -> None:
        super().__init__(RUNNING)
        self.unanswered, self.reason = unanswered, reason

    def send(self, *given: Any, **told: Any) -> Answer:
        answer = super().send(*given, **told)
        return answer if len(self.sent) > self.unanswered else Answer(False, self.reason)


@pytest.fixture
def client() -> FakeClient:
    return FakeClient(RUNNING)


@pytest.fixture(autouse=True)
def _short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rig.stream.client.HEARD_AGAIN_S", 0.01)
    monkeypatch.setattr("rig.console.orders.STOP_S", 0.2)
    monkeypatch.setattr("rig.console.standing_stop.STANDS_S", 0.4)


def orders(
    client: FakeClient, launcher: Launcher, say: Callable[[str], None] = lambda text: None
) -> Orders:
    control = ControlHolder(lambda text: None)
    control.take(ANNA)
    return Orders(client, control, launcher, say=say)


def test_a_stop_that_the_stream_answers_leaves_processes_alone(
    client: FakeClient, tmp_path: Path
) -> None:
    launcher = FakeLauncher(tmp_path, ASKED)
    assert orders(client, launcher).carry_out(Order("stop", "bench"), ANNA) == Answer(True)
    assert (client.sent, launcher.asked) == ([("abort", "bench", "Anna", "")], [])


def test_an_order_with_a_key_twice_is_refused_by_the_key_s_name() -> None:
    with pytest.raises(MalformedError, match="has the key 'rig' twice"):
        parse(b'{"order": "stop", "rig": "bench", "rig": "other"}')


@pytest.mark.parametrize("rig", ["bench", "unheard"])
@pytest.mark.parametrize("done", [ASKED, INTERRUPTED])
def test_a_stop_that_the_stream_does_not_take_stops_what_was_started_here_and_says_how(
    client: FakeClient, tmp_path: Path, rig: str, done: str
) -> None:
    client.answer = Answer(False, "no answer")
    launcher = FakeLauncher(tmp_path, done)
    answer = orders(client, launcher).carry_out(Order("stop", rig, "enough"), ANNA)
    assert (answer.accepted, launcher.asked) == (True, ["stop: Anna: enough"])
    assert ("interrupted" in answer.reason) is (done == INTERRUPTED)
    nothing = orders(client, FakeLauncher(tmp_path)).carry_out(Order("stop", rig), ANNA)
    assert not nothing.accepted


@pytest.mark.parametrize("reason", ["no answer: nobody", f"replayed: {OTHER_SESSION}"])
def test_a_stop_of_a_rig_that_is_being_connected_is_said_until_it_is_heard(
    tmp_path: Path, reason: str
) -> None:
    client = Connecting(3, reason)
    assert orders(client, FakeLauncher(tmp_path)).carry_out(Order("stop", "bench"), ANNA).accepted
    assert client.sent == [("abort", "bench", "Anna", "")] * 4
    assert client.persons == ["Anna"] * 4


def test_a_stop_that_is_heard_late_says_that_it_stands_and_then_that_it_was_heard(
    tmp_path: Path,
) -> None:
    client, said = FakeClient(), list[str]()
    desk = orders(client, FakeLauncher(tmp_path), said.append)
    answer = desk.carry_out(Order("stop", "bench", "enough"), ANNA)
    assert (answer.accepted, said) == (False, [])
    assert "nobody hears it yet" in answer.reason
    assert "whatever begins on bench within 15 s is stopped" in answer.reason
    client.shots["bench"] = RUNNING
    until(lambda: bool(said), "the stop to be heard")
    assert said == ["bench: the stop of Anna was heard, and is obeyed"]
    assert client.sent == [("abort", "bench", "Anna: enough", "")]


def test_a_stop_that_a_rig_refuses_does_not_stand(tmp_path: Path) -> None:
    client = Connecting(9, "nothing moves; the rig is disarmed")
    answer = orders(client, FakeLauncher(tmp_path)).carry_out(Order("stop", "bench"), ANNA)
    assert answer == Answer(False, "nothing moves; the rig is disarmed")
    assert len(client.sent) == 1


def test_a_second_stop_of_a_run_that_is_ending_is_no_failure_of_the_first(
    client: FakeClient, tmp_path: Path
) -> None:
    client.answer = Answer(False, "no answer")
    answer = orders(client, FakeLauncher(tmp_path, ENDING)).carry_out(Order("stop", "bench"), ANNA)
    assert answer == Answer(True, REASONS[ENDING])


def test_nothing_is_started_on_a_rig_that_runs(client: FakeClient, tmp_path: Path) -> None:
    launcher = FakeLauncher(tmp_path)
    desk = orders(client, launcher)
    for order in (Order("start", name="a"), Order("go on", name="out")):
        refused = desk.carry_out(order, ANNA)
        assert (refused.accepted, refused.reason) == (False, "bench has a campaign running")
    assert desk.carry_out(Order("start", name="b"), ANNA).accepted
    client.become("bench", alive=False)
    assert desk.carry_out(Order("start", name="a"), ANNA).accepted
    assert desk.carry_out(Order("go on", name="out"), ANNA).accepted
    assert launcher.asked == ["start b by Anna", "start a by Anna", "go on out by Anna"]


def test_a_campaign_is_started_on_a_rig_that_its_station_only_reads(
    client: FakeClient, tmp_path: Path
) -> None:
    launcher = FakeLauncher(tmp_path)
    client.become("bench", campaign={"status": "idle", "activity": "idle: nothing drives"})
    assert orders(client, launcher).carry_out(Order("start", name="a"), ANNA).accepted
    assert launcher.asked == ["start a by Anna"]


def test_a_remark_has_its_writers_name(client: FakeClient, tmp_path: Path) -> None:
    desk = orders(client, FakeLauncher(tmp_path))
    told: dict[str, Any] = {"rig": "bench", "text": "oil", "name": "first"}
    assert desk.carry_out(Order("retry", **told), ANNA).accepted
    assert client.sent == [("retry", "bench", "Anna: oil", "first")]
    assert client.persons == ["Anna"]


def test_the_end_of_a_run_is_acknowledged_in_its_journal_and_not_at_the_rig(
    client: FakeClient, tmp_path: Path
) -> None:
    launcher = FakeLauncher(tmp_path)
    desk = orders(client, launcher)
    assert desk.carry_out(Order("acknowledge", "bench", "it was me", "out-1"), ANNA).accepted
    assert (client.sent, launcher.asked) == ([], ["acknowledge out-1 by Anna: it was me"])
