"""What a rig's connection waits for: an answer of a part, but not after one that cannot be read."""

import json
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from rig.configuration.rigs.rig import load_rig
from rig.io.driver import DriverError
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.loop import Board, Cause, Closed, StopRequestedError, TripError, Word
from rig.plant import Model
from rig.runner.campaign.setting import TELLING_S
from rig.runner.campaign.stopping import StopFlag
from rig.supervisor.connected_rig import ConnectedRig
from rig.supervisor.processes import Onlooker, Parts
from rig.supervisor.processes.child import Child, ChildError, NoAnswerError
from rig.supervisor.processes.health import trip
from rig.supervisor.processes.safety_thread import SafetyThread
from rig.supervisor.session import Session
from rig.supervisor.states import State
from tests.waiting import PATIENCE_S


class Part(Child):
    """A part that takes every order, and answers it at the third time of asking.

    Args:
        answer: the answer, or an error that is raised in its place.
    """

    compiles = ""

    def __init__(self, answer: object) -> None:
        late = NoAnswerError("part process: did not answer")
        self._told: Iterator[object] = iter([late, late, answer])

    @property
    def ended(self) -> str:
        return ""

    def send(self, order: object) -> None:
        """Take an order."""

    def answer(self, timeout_s: float) -> object:
        answer = next(self._told)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.fixture
def rig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ConnectedRig:
    stop = SimpleNamespace(requested=False, reason="")
    rig = ConnectedRig(load_rig("emulated"), "product", Model(), tmp_path, stop, lambda line: None)
    safety = SimpleNamespace(alive=lambda: None)
    monkeypatch.setattr(rig, "safety", safety, raising=False)
    return rig


def test_the_operator_hears_of_an_expired_calibration_before_any_device_is_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = (CalibrationPoint(0.0, 0.0), CalibrationPoint(1e7, 1e7))
    old = TransducerCalibration("load_N", "L-1", date(2001, 1, 1), date(2002, 1, 1), points)
    stop, heard = SimpleNamespace(requested=False, reason=""), list[str]()
    configured = replace(load_rig("emulated"), calibrations=(old,))
    rig = ConnectedRig(configured, "product", Model(), tmp_path, stop, heard.append)

    def used_by_another(drivers: object) -> None:
        raise DriverError("daq", "is in use", "end what uses it")

    monkeypatch.setattr("rig.supervisor.holding.exclusive", used_by_another)
    with pytest.raises(DriverError, match="is in use"):
        rig.connect()
    assert heard[0].startswith(
        "warning: the calibration of load_N (transducer L-1) expired on 2002-01-01"
    )


Ask = Callable[[ConnectedRig, Child], Any]
WAYS: dict[str, Ask] = {
    "ask": lambda rig, part: rig.ask(part, "order", PATIENCE_S),
    "open": lambda rig, part: part.ask_patiently("order", PATIENCE_S, 3.0, rig._heed_stop),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_late_answer_is_waited_for(rig: ConnectedRig, way: str) -> None:
    assert WAYS[way](rig, Part("done")) == "done"


@pytest.mark.parametrize("way", WAYS)
def test_an_answer_that_cannot_be_read_is_an_error_at_once(rig: ConnectedRig, way: str) -> None:
    unreadable = ChildError("part process: sent what cannot be read: LookupError")
    with pytest.raises(ChildError, match="sent what cannot be read"):
        WAYS[way](rig, Part(unreadable))


def test_a_part_that_never_answers_is_said_to_have_been_waited_for_as_long_as_it_was(
    rig: ConnectedRig,
) -> None:
    part = Part("never")
    part.name = "loop"
    with pytest.raises(NoAnswerError, match="loop process: did not answer within 0 s"):
        part.ask_patiently("order", 0.0, 3.0, rig._heed_stop)


def test_the_time_in_which_a_part_compiles_does_not_count(rig: ConnectedRig) -> None:
    part, looks = Part("done"), list[str]()
    part.compiles = "wire_ticks"
    assert part.ask_patiently("order", 0.0, 3.0, lambda: looks.append(part.compiles)) == "done"
    assert looks == ["wire_ticks", "wire_ticks"]


@pytest.mark.parametrize("way", WAYS)
def test_the_last_word_of_a_loop_that_ends_by_itself_is_no_answer_to_an_order(
    rig: ConnectedRig, way: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    gone = ChildError("loop process: ended with exit code 28")
    monkeypatch.setattr(Part, "_gone", lambda self: gone)
    with pytest.raises(ChildError, match="exit code 28"):
        WAYS[way](rig, Part(Closed("")))


def test_a_stop_while_the_devices_are_opened_ends_that_and_says_who_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stop, done = StopFlag(), list[str]()

    class Stops(Onlooker):
        """An onlooker through whom Ada stops what has only begun to connect."""

        def connects(self, board: Board, channels: tuple[str, ...]) -> None:
            stop.request("Ada")

        def came_to(self, state: str) -> None:
            done.append(state)

    part = SimpleNamespace(end=lambda: None)
    parts = SimpleNamespace(field=Part("opened"), loop=part, recorder=part)
    monkeypatch.setattr(Part, "end", lambda self, timeout_s=0.0: None)
    monkeypatch.setattr("rig.supervisor.connected_rig.held", lambda *given: nullcontext(()))
    monkeypatch.setattr(Parts, "start", lambda *given: parts)
    rig = ConnectedRig(
        load_rig("emulated"), "product", Model(), tmp_path, stop, lambda line: None, Stops()
    )
    with pytest.raises(StopRequestedError, match="stopped by Ada"):
        rig.connect()
    assert done == ["connecting", "off"]


class Leaving(ConnectedRig):
    """A rig that is at rest, of which a part trips at a moment of its leaving.

    Attributes:
        trips_at: "check", before the first look; "end", while the loop is closed; "never"; or
            "error", with which making the field safe fails otherwise.
    """

    trips_at: str

    def made(self, trips_at: str) -> "Leaving":
        self.trips_at = trips_at
        self._channels = ("time_s", "estop_closed", "valve_enabled")
        self.board, self.state = Board.create(len(self._channels)), State.DISARMED
        tripped = property(lambda safety: bool(self.board.words[Word.LOOP_TRIP]))
        known = {"tripped": tripped, "made_safe": {}, "wait_until_safe": lambda *_: True}
        nothing = {name: lambda *_: None for name in ("stand_down", "stop", "alive")}
        standing_down = {"standing_down": SafetyThread.standing_down}
        self.safety = type("Safety", (), {**known, **nothing, **standing_down})()
        self.ended: list[str] = []
        return self

    def _trips_if(self, at: str) -> None:
        if self.trips_at == at:
            trip(self.board.words, "loop", Cause.OVERRUN)

    def make_field_safe(self) -> dict[str, str]:
        self._trips_if("check")
        if self.trips_at == "error":
            trip(self.board.words, "loop", Cause.OVERRUN)
            raise MemoryError
        return {}

    def _close_loop(self) -> dict[str, str]:
        self._trips_if("end")
        return {}

    def _end_parts(self) -> None:
        self.ended.append("parts")


@pytest.mark.parametrize(
    ("at", "raised"),
    [("check", TripError), ("end", TripError), ("error", MemoryError), ("never", None)],
)
def test_every_trip_has_its_report_also_one_that_comes_while_the_rig_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, at: str, raised: type[BaseException] | None
) -> None:
    monkeypatch.setattr("rig.supervisor.trip_report.LAST_NEWS_S", 0.0)
    stop = SimpleNamespace(requested=False, reason="")
    rig = Leaving(load_rig("emulated"), "product", Model(), tmp_path, stop, lambda line: None)
    with nullcontext() if raised is None else pytest.raises(raised):
        rig.made(at).leave()
    assert rig.ended == ["parts"]
    reports = [json.loads(path.read_text()) for path in tmp_path.glob("trip-*.json")]
    assert [report["cause"] for report in reports] == ([] if raised is None else ["OVERRUN"])


def test_a_supervisor_that_is_ended_as_its_cleanup_hangs_trips_and_leaves_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.supervisor.trip_report.LAST_NEWS_S", 0.0)
    waited: list[float] = []
    stop = SimpleNamespace(requested=False, reason="")
    rig = Leaving(load_rig("emulated"), "product", Model(), tmp_path, stop, lambda line: None)
    safety: Any = rig.made("never").safety
    safety.trip = lambda cause: trip(rig.board.words, "supervisor", cause)

    def not_safe(wait_s: float) -> bool:
        waited.append(wait_s)
        return False

    safety.wait_until_safe = not_safe
    Session(rig).is_overdue()
    report = json.loads((tmp_path / "trip-1.json").read_text())
    assert (report["by"], report["cause"]) == ("supervisor", "SUPERVISOR_LOST")
    assert waited[0] < TELLING_S
    said = [note["what"] for note in report["notes"]]
    assert "cleaning up takes too long, and its process ends" in said
    assert "not everything was made safe in time" in said
