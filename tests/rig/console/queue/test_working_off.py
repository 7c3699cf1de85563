"""The queue is worked off while somebody wants it, and halts when somebody should look."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.accounts import Role, why_not
from rig.console.launcher import Launcher, LaunchRefused, Offer, Served
from rig.console.orders import QUEUE, STOP, Order, Orders
from rig.console.queue import Queue, QueueError, QueueFile, working_off
from rig.console.visitors import ControlHolder, Visitor

from ..fakes import RUNNING, FakeClient

ANNA, BO = Visitor(1, "Anna", 9e9), Visitor(2, "Bo", 9e9)


class FakeLauncher(Launcher):
    """A launcher whose runs last until a test ends them."""

    def __init__(self, folder: Path) -> None:
        offers = (Offer("a", "a", "", "bench", 1), Offer("b", "b", "", "bench", 1))
        super().__init__(Served(offers, folder, "loopback"), lambda text: None)
        self.begun: list[tuple[str, str]] = []
        self.running: Any = None
        self.refusal = ""
        self.stops: list[str] = []

    def start(self, name: str, by: str) -> None:
        if self.refusal:
            raise LaunchRefused(self.refusal)
        self.begun.append((name, by))
        self.running = SimpleNamespace(name=name, exit_code=None, asked=False, stopped=False)

    def present(self) -> Any:
        return self.running if self.running and self.running.exit_code is None else None

    def stop(self, said: str, by: str = "") -> str:
        self.stops.append(said)
        return ""


class Bench:
    """A queue of a and b, with the orders of Anna, who has control."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.client = FakeClient(RUNNING)
        self.client.become("bench", alive=False, campaign={"status": "ended", "exit_code": 0})
        self.launcher = FakeLauncher(folder)
        self.said: list[str] = []
        self.queue = Queue(QueueFile(folder), self.launcher, self.client, self.said.append)
        self.queue.offer()
        control = ControlHolder(lambda text: None)
        control.take(ANNA)
        self.orders = Orders(self.client, control, self.launcher, self.queue)
        self.order("queue add", "a")
        self.queue.add("b", "Bo")

    def order(self, order: str, name: str = "", text: str = "", who: Visitor = ANNA) -> str:
        return self.orders.carry_out(Order(order, "bench", text, name), who).reason

    def end(self, exit_code: int) -> None:
        self.launcher.running.exit_code = exit_code
        self.orders.work_off_queue()

    @property
    def waiting(self) -> list[str]:
        return [each["campaign"] for each in self.queue.content()["entries"]]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_one_after_another_is_started_once_somebody_wants_it(bench: Bench) -> None:
    bench.orders.work_off_queue()
    assert bench.launcher.begun == []
    assert bench.order("queue start") == ""
    bench.orders.work_off_queue()
    bench.orders.work_off_queue()
    assert bench.launcher.begun == [("a", "Anna")]
    assert bench.waiting == ["b"]
    bench.end(1)  # a test failed: the campaign came to its end all the same
    assert bench.launcher.begun[1:] == [("b", "Bo, queue of Anna")]
    bench.end(0)
    content = bench.queue.content()
    assert (content["entries"], content["by"]) == ([], "")
    assert content["why"] == "all that was queued has run"
    assert bench.order("queue start") == "nothing is queued; add a campaign first"


def test_another_campaign_than_was_shown_beforehand_is_not_begun(bench: Bench) -> None:
    bench.queue.move("2", "first")
    refusal = bench.order("queue start", "1")
    assert refusal == "b comes first by now; see what its start would do"
    bench.orders.work_off_queue()
    assert bench.launcher.begun == []
    assert bench.order("queue start", "2") == ""
    bench.orders.work_off_queue()
    assert [name for name, _ in bench.launcher.begun] == ["b"]


def test_what_is_asked_for_again_as_its_answer_was_lost_is_queued_once(bench: Bench) -> None:
    for mark in ("m1", "m1", "m2", "m1"):
        assert bench.order("queue add", "a", mark) == ""
    assert bench.waiting == ["a", "b", "a", "a"]
    assert bench.queue.content()["marks"] == ["m1", "m2"]
    bench.queue.remove("3")
    # Another console reads the same file.
    assert [each.number for each in QueueFile(bench.folder).add("a", "Anna", "m1").entries] == [
        1, 2, 4,
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("exit_code", "how"),
    [(2, "ended with exit code 2"), (3, "ended with exit code 3"), (-9, "was killed by SIGKILL")],
)
def test_after_a_trip_a_stop_or_a_kill_nothing_more_is_started(
    bench: Bench, exit_code: int, how: str
) -> None:
    bench.order("queue start")
    bench.orders.work_off_queue()
    bench.end(exit_code)
    assert bench.launcher.begun == [("a", "Anna")]
    assert bench.queue.content()["why"] == f"a {how}"
    assert bench.waiting == ["b"]


def test_whoever_stops_halts_the_queue_as_well_even_while_its_start_is_written(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.order("queue start")
    plain = bench.queue.file.begin
    stopped: list[bool] = []

    def begin(number: int, is_begun: bool) -> Any:
        held = plain(number, is_begun)
        if not stopped:
            stopped.append(True)
            bench.order(STOP, who=BO)
        return held

    monkeypatch.setattr("rig.console.queue.working_off.HALT_S", 0.01)
    monkeypatch.setattr(bench.queue.file, "begin", begin)
    bench.orders.work_off_queue()
    assert bench.launcher.begun == []
    assert bench.waiting == ["a", "b"]
    assert bench.queue.content()["why"] == "Bo has stopped bench"


def test_a_run_that_was_stopped_before_the_queue_was_started_does_not_halt_it(
    bench: Bench,
) -> None:
    bench.launcher.running = SimpleNamespace(name="old", exit_code=None, asked=True, stopped=True)
    bench.order("queue start")
    bench.orders.work_off_queue()
    assert bench.queue.content()["why"] == "waits for the end of old"
    bench.end(3)
    assert bench.launcher.begun == [("a", "Anna")]


def test_a_rig_that_something_else_drives_is_waited_for_unless_that_ends_badly(
    bench: Bench,
) -> None:
    for exit_code, begun in ((0, 1), (3, 1)):
        bench.client.become("bench", alive=True, campaign={"status": "running"})
        bench.order("queue start")
        bench.orders.work_off_queue()
        assert bench.queue.content()["why"] == "waits for bench, which something else drives"
        ended = {"status": "ended", "exit_code": exit_code}
        bench.client.become("bench", alive=False, campaign=ended)
        bench.orders.work_off_queue()
        assert len(bench.launcher.begun) == begun
        bench.launcher.running = None
    assert bench.queue.content()["why"] == "what drove bench ended with exit code 3"


def test_a_console_that_is_started_anew_starts_nothing_by_itself(
    bench: Bench, tmp_path: Path
) -> None:
    bench.order("queue start")
    bench.queue.file.begin(1, True)  # the console is killed in the moment of the start
    again = Queue(QueueFile(tmp_path), bench.launcher, bench.client, bench.said.append)
    again.look()
    assert bench.launcher.begun == []
    again.begin("Anna")
    again.look()
    assert bench.launcher.begun == []
    assert "see whether it ran" in again.content()["why"]
    again.remove("1")
    again.begin("Anna")
    again.look()
    assert bench.launcher.begun == [("b", "Bo, queue of Anna")]


def test_a_start_that_is_refused_stays_in_the_queue_with_its_reason(bench: Bench) -> None:
    bench.launcher.refusal = "it cannot be started: no memory"
    bench.order("queue start")
    bench.orders.work_off_queue()
    assert bench.waiting == ["a", "b"]
    assert bench.queue.content()["why"].startswith("a was not started: it cannot be started")


def test_who_has_not_control_or_not_the_role_changes_nothing(bench: Bench) -> None:
    for order in QUEUE:
        assert "control" in bench.order(order, "1", "later", who=BO)
        assert why_not(order, Role.VIEWER)
    assert bench.waiting == ["a", "b"]
    assert bench.order("queue move", "1", "away") == "an entry is moved earlier, later or first"
    assert bench.order("queue remove", "x") == "name the entry by its number"


def test_a_stop_that_comes_while_the_queue_s_start_reads_its_file_holds(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = bench.queue.file.read

    def stopped_amid() -> Any:
        held = read()
        monkeypatch.setattr(bench.queue.file, "read", read)
        bench.order(STOP, who=BO)
        return held

    monkeypatch.setattr(bench.queue.file, "read", stopped_amid)
    assert "somebody has stopped meanwhile" in bench.order("queue start")
    bench.orders.work_off_queue()
    assert bench.launcher.begun == []


def test_a_stop_that_finds_no_run_yet_as_the_disk_hangs_stops_the_one_that_comes(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(working_off, "HALT_S", 0.0)
    start = bench.launcher.start

    def stopped_amid(name: str, by: str) -> None:
        bench.order(STOP, who=BO)
        start(name, by)

    monkeypatch.setattr(bench.launcher, "start", stopped_amid)
    bench.order("queue start")
    bench.launcher.stops.clear()
    bench.orders.work_off_queue()
    assert bench.launcher.stops[-1] == "Bo has stopped bench"


def test_what_ended_unseen_halts_it(bench: Bench) -> None:
    bench.order("queue start")
    bench.client.become("bench", alive=True, campaign={"status": "running", "begun_ns": 1})
    bench.orders.work_off_queue()
    bench.client.become("bench", alive=True, campaign={"status": "idle", "begun_ns": 2})
    bench.orders.work_off_queue()
    assert bench.launcher.begun == []
    assert bench.queue.content()["why"] == "how what drove bench ended was not seen"


def test_why_a_start_was_refused_is_told_also_where_the_file_cannot_be_written_any_more(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = bench.queue.file.begin

    def undone(number: int, is_begun: bool) -> Any:
        if not is_begun:
            raise QueueError("the disk is full")
        return begin(number, is_begun)

    monkeypatch.setattr(bench.queue.file, "begin", undone)
    bench.launcher.refusal = "the folder cannot be made"
    bench.order("queue start")
    bench.orders.work_off_queue()
    assert bench.queue.content()["why"] == "a was not started: the folder cannot be made"
