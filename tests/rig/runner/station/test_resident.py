"""A station reads its rig while nothing drives it, lends it, and comes back whatever happens."""

import json
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rig.configuration import load_rig
from rig.io.driver import DriverError
from rig.loop.interlocks.trip import TripError
from rig.plant import Model
from rig.runner.campaign.stopping import StopFlag
from rig.runner.run_folder.acknowledging import acknowledge_ended
from rig.runner.run_folder.journal import JOURNAL, Journal, read_journal
from rig.runner.station import last_use, resident as module
from rig.runner.station.last_use import LastUse
from rig.runner.station.resident import NOTHING_MOVES, Resident
from rig.runner.station.station_log import LOG, StationLog
from rig.stream import Command
from rig.supervisor import Onlooker
from rig.supervisor.leases.keeper import Lease
from tests.waiting import until

SINCE = datetime(2026, 11, 28, tzinfo=UTC)


class Keeper:
    """Keeps a lease that the test gives, and what the station did about it."""

    def __init__(self) -> None:
        self.changed = threading.Event()
        self.lease: Any = None
        self.state = ""
        self.refused: list[str] = []
        self.heard: Callable[[], None] = lambda: None
        self.granted = threading.Event()

    @property
    def asked(self) -> Any:
        return self.lease if self.lease is not None and not self.lease.granted else None

    def asks(self) -> Any:
        self.granted.clear()
        self.lease = Lease("homing", "Bo", 7, SINCE, cast(Any, None))
        self.changed.set()
        return self.lease

    def ends(self, *, said: bool) -> None:
        self.lease.said_end = said
        self.lease = None
        self.changed.set()

    def holds(self, lease: Lease) -> bool:
        return self.lease is lease

    def grant(self, lease: Any) -> bool:
        lease.granted = True
        self.granted.set()
        return True

    def refuse(self, lease: Lease, problem: str, remedy: str) -> None:
        self.refused.append(problem)
        self.lease = None

    def stands(self, state: str, text: str) -> None:
        self.state = state


class Session:
    """A session of a rig whose devices answer as they are told to.

    Attributes:
        connects: errors of the next attempts to connect, None for none.
        trips: the error of the next look at the rig.
        unsafe: the error of leaving the rig.
        left: how often the rig was left.
    """

    connects: list[Exception | None]
    trips: list[TripError]
    unsafe: list[TripError]
    balls = 0.0
    left = 0
    parts = SimpleNamespace(field=None)
    itself: "Session"

    def connect(self) -> None:
        error = Session.connects.pop(0) if Session.connects else None
        if error is not None:
            raise error

    def going_on(self) -> None:
        if Session.trips:
            raise Session.trips.pop()

    def leave(self) -> None:
        Session.left += 1
        if Session.unsafe:
            raise Session.unsafe.pop()

    def latest(self, channel: str) -> float:
        return 0.0

    def slow(self, channel: str) -> float:
        return Session.balls

    def ask(self, part: Any, order: object, timeout_s: float) -> dict[str, str]:
        return {}


class Station(Onlooker):
    """A station in a thread, with what it keeps in its log and has told its onlooker."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.keeper = Keeper()
        self.stop = StopFlag()
        self.obey: Callable[[Command], str] = lambda command: ""
        log = StationLog(folder, lambda line: None)
        self.resident = Resident(
            load_rig("emulated"), Model(), folder, cast(Any, self.keeper), self.stop, log,
            self._watched, self._session,
        )  # fmt: skip
        self.sessions: weakref.WeakSet[Session] = weakref.WeakSet()
        self.ended_with: TripError | None = None
        self.handed_over: list[str] = []
        self.compiled: list[str] = []
        self.told: list[Mapping[str, Any]] = []
        self.thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            self.resident.run()
        except TripError as error:
            self.ended_with = error

    def _session(self, *_: Any) -> Any:
        session = Session()
        self.sessions.add(session)
        # Also the parts of a real one refer to one another.
        session.itself = session
        return session

    @contextmanager
    def _watched(self, obey: Any) -> Iterator[Any]:
        self.obey = obey
        yield lambda line: None, self

    def hands_over(self, to: str) -> None:
        self.handed_over.append(to)

    def compiles(self, what: str) -> None:
        self.compiled.append(what)

    def ends_for(self, reason: str) -> None:
        self.compiled.append(reason)

    def came_before(self, last: Mapping[str, Any]) -> None:
        self.told.append(last)

    def last(self, name: str) -> Any:
        """Return what it tells of what drove last, of this name, where it is read."""
        return self.told[-1].get(name) if self.told else None

    def kept(self, kind: str) -> list[str]:
        path = self.folder / LOG
        lines = path.read_text().splitlines() if path.exists() else []
        return [entry["text"] for entry in map(json.loads, lines) if entry["kind"] == kind]

    def reads(self) -> None:
        until(lambda: self.keeper.state == "idle", "the station to read")


@pytest.fixture
def station(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Station]:
    Session.connects, Session.trips, Session.unsafe = [], [], []
    Session.left, Session.balls = 0, 0.0
    monkeypatch.setattr(module, "AGAIN_S", (0.01,))
    monkeypatch.setattr(module, "POLL_S", 0.01)
    monkeypatch.setattr(module, "is_compiled", lambda *_: True)
    station = Station(tmp_path)
    yield station
    station.stop.request("SIGTERM")
    station.keeper.changed.set()
    if station.thread.ident:
        station.thread.join()
        assert station.kept("ended") == ["station of emulated ended by SIGTERM"]


def test_it_says_by_its_devices_answers_how_it_found_the_rig(station: Station) -> None:
    station.thread.start()
    station.reads()
    (found,) = station.kept("found")
    assert found.endswith("valve disabled, command 0.00 V, bypasses shut, pump unloaded")


def test_what_is_not_safe_when_it_comes_is_named(station: Station) -> None:
    Session.balls = 1.0
    station.thread.start()
    station.reads()
    assert "internal_leakage OPEN" in station.kept("found")[0]
    assert "pump LOADED" in station.kept("found")[0]


def test_it_is_heard_while_it_compiles_and_lends_the_rig_meanwhile(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    done, begun = threading.Event(), threading.Event()

    def compile_for(needs: Any, names: Any, say: Callable[[str], None], stop: Any) -> None:
        say("compiled the filter, 1 of 3")
        begun.set()
        until(lambda: done.is_set() or stop.requested, "the compiling to be over")

    monkeypatch.setattr(module, "is_compiled", lambda *_: done.is_set())
    monkeypatch.setattr(module, "compile_for", compile_for)
    station.thread.start()
    assert begun.wait(60.0)
    assert station.compiled == ["filter, change of control, loop"]
    assert station.obey(Command("abort", "local", "", 1)) == NOTHING_MOVES
    station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    begun.clear()
    station.keeper.ends(said=True)
    assert begun.wait(60.0)
    done.set()
    station.reads()
    assert station.compiled[-1] == module.COMPILED
    assert station.kept("told") == ["compiled the filter, 1 of 3"] * 2


@pytest.mark.parametrize(("said", "kind"), [(True, "returned"), (False, "died")])
def test_it_leaves_the_rig_to_who_asks_and_takes_it_back(
    station: Station, said: bool, kind: str
) -> None:
    station.thread.start()
    station.reads()
    station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    assert Session.left == 1
    station.keeper.ends(said=said)
    until(lambda: len(station.kept("found")) == 2, "the rig to be read again")
    assert station.handed_over == ["homing, asked by Bo"]
    assert station.kept("lent") == ["homing, asked by Bo, drives (process 7)"]
    assert station.kept(kind)


def used(station: Station, *, said: bool = True, **told: Any) -> None:
    """Have somebody drive the rig of a station, who says in the end what is told."""
    times = len(station.kept("found"))
    lease = station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    station.keeper.ends(said=said)
    until(lambda: len(station.kept("found")) == times + 1, "the rig to be read again")
    if told:
        lease.told = {"decision": {}, "trips": {}, "folder": ""} | told
        station.keeper.heard()


def test_how_what_drove_last_ended_is_told_until_and_when_somebody_has_acknowledged_it(
    station: Station, tmp_path: Path
) -> None:
    station.thread.start()
    station.reads()
    acknowledge = Command("acknowledge", "local", "Ada: the hose", 1, person="Ada")
    assert station.obey(acknowledge) == "nothing that has ended waits to be acknowledged"
    used(station, campaign={"name": "homing", "exit_code": 3, "reason": "a trip"})
    until(lambda: station.last("campaign")["reason"] == "a trip", "the end")
    assert "folder" not in station.told[-1]
    # A station that is started again tells it too.
    again = LastUse(tmp_path, print)
    assert again.content == station.told[-1]
    assert station.obey(acknowledge) == ""
    until(lambda: station.last("acknowledged"), "the acknowledgement")
    seen = {"by": "Ada", "text": "the hose"}
    assert station.last("acknowledged").items() >= seen.items()
    assert station.kept("acknowledged") == ["Ada has seen how homing ended"]
    assert LastUse(tmp_path, print).content["acknowledged"].items() >= seen.items()
    assert station.obey(acknowledge) != ""
    used(station)
    assert station.last("campaign")["reason"] == "its program has not told the station how it ended"
    assert station.last("acknowledged") is None
    used(station, said=False)
    assert station.last("campaign")["reason"] == "its process died without a word"


def test_how_it_ended_is_told_at_once_also_while_the_station_still_opens_the_devices(
    station: Station, monkeypatch: pytest.MonkeyPatch
) -> None:
    station.thread.start()
    station.reads()
    opening, opened = threading.Event(), threading.Event()

    def connect(_: Session) -> None:
        opening.set()
        opened.wait(60.0)

    monkeypatch.setattr(Session, "connect", connect)
    lease = station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    station.keeper.ends(said=True)
    assert opening.wait(60.0)
    lease.told = {"campaign": {"name": "leaks"}, "decision": {}, "trips": {}, "folder": ""}
    station.keeper.heard()
    assert station.last("campaign") == {"name": "leaks"}
    opened.set()


def homing(by: str = "Bo") -> Lease:
    return Lease("homing", by, 7, SINCE, cast(Any, None))


def told(folder: Path, sentence: str = "", name: str = "leaks") -> dict[str, Any]:
    trips = {"first_out": [{"sentence": sentence}]} if sentence else {}
    campaign = {"name": name, "begun_by": "Ada", "activity": ""}
    return {"campaign": campaign, "decision": {}, "trips": trips, "folder": str(folder)}


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_trip_that_nobody_has_acknowledged_is_told_until_somebody_has_also_after_other_uses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: bool
) -> None:
    monkeypatch.setattr(last_use, "LOOK_S", 0.0)
    with Journal(tmp_path) as journal:
        journal.write("begin", campaign="leaks", tests=["one"])
        journal.write("end", reason="a trip", exit_code=3)
    last = LastUse(tmp_path, print)
    for said in (told(tmp_path, "the stop is open"), told(tmp_path / "none", name="second")):
        lease = homing()
        last.lent(lease)
        lease.told = said
        last.ended(lease)
    (trip,) = LastUse(tmp_path, print).content["unseen"]
    assert (trip["name"], trip["sentence"], trip["begun_by"]) == (
        "leaks", "the stop is open", "Ada"
    )  # fmt: skip
    assert "folder" not in trip
    assert last.content["campaign"]["name"] == "second"
    if elsewhere:
        acknowledge_ended(tmp_path, "bo", "seen", "Ada")
        assert last.look()
        assert "acknowledged" not in last.content
    else:
        assert last.acknowledge("local", "Ada", "Ada: seen") == ""
        assert last.content["acknowledged"]["by"] == "Ada"
        assert read_journal(tmp_path / JOURNAL)[-1]["person"] == "Ada"
    assert last.content["unseen"] == []


def test_what_several_threads_of_a_station_tell_is_written_one_after_the_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    writing, at_once = threading.Lock(), []

    def write(path: Path, text: str) -> None:
        if not writing.acquire(blocking=False):
            at_once.append(text)
            return
        threading.Event().wait(0.005)
        writing.release()

    monkeypatch.setattr(last_use, "replace_text", write)
    last = LastUse(tmp_path, print)
    threads = [threading.Thread(target=last.lent, args=(homing(),)) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not at_once


@pytest.mark.parametrize("elsewhere", [False, True])
def test_that_a_run_was_acknowledged_stands_in_its_own_journal(
    station: Station, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, elsewhere: bool
) -> None:
    monkeypatch.setattr(last_use, "LOOK_S", 0.0)
    with Journal(tmp_path) as journal:
        journal.write("begin", campaign="leaks", tests=["one"])
        journal.write("end", reason="Bo", exit_code=3)
    station.thread.start()
    station.reads()
    used(station, campaign={"name": "leaks"}, folder=str(tmp_path))
    until(lambda: station.last("campaign") == {"name": "leaks"}, "the end")
    if elsewhere:
        acknowledge_ended(tmp_path, "bo", "seen", "Ada")
    else:
        assert station.obey(Command("acknowledge", "local", "Ada: seen", 1, person="Ada")) == ""
    until(lambda: station.last("acknowledged"), "the acknowledgement")
    assert (station.last("acknowledged")["by"], station.last("acknowledged")["text"]) == (
        "Ada", "seen"
    )  # fmt: skip
    (entry,) = [each for each in read_journal(tmp_path / JOURNAL) if each.kind == "operator"]
    assert (entry["request"], entry["person"], entry["text"]) == ("acknowledge", "Ada", "seen")


def test_a_rig_that_was_not_left_safe_is_not_lent(station: Station) -> None:
    station.thread.start()
    station.reads()
    Session.unsafe = [TripError("bypass: not safe: no answer")]
    station.keeper.asks()
    until(lambda: station.keeper.refused, "the refusal")
    assert station.keeper.refused == ["bypass: not safe: no answer"]
    assert not station.keeper.granted.is_set()
    assert station.kept("unsafe") == station.keeper.refused


@pytest.mark.parametrize("error", [DriverError("daq", "nobody answers", ""), OSError("no files")])
def test_devices_that_are_lost_are_told_once_and_tried_until_they_are_back(
    station: Station, error: Exception
) -> None:
    Session.connects = [error, error, error]
    station.thread.start()
    station.reads()
    (lost,) = station.kept("lost")
    assert str(error).rstrip("; ") in lost


def test_a_station_that_ends_without_a_safe_rig_says_so(station: Station) -> None:
    station.thread.start()
    station.reads()
    Session.unsafe = [TripError("bypass: not safe: no answer")]
    station.stop.request("SIGTERM")
    station.thread.join()
    assert str(station.ended_with) == "bypass: not safe: no answer"


def test_a_trip_while_idle_is_kept_and_the_rig_is_read_again(station: Station) -> None:
    station.thread.start()
    station.reads()
    Session.trips = [TripError("the field process is lost")]
    until(lambda: len(station.kept("found")) == 2, "the rig to be read again")
    assert "the field process is lost" in station.kept("lost")[0]


def _has_found(station: Station, times: int) -> bool:
    return len(station.kept("found")) == times


def test_nothing_is_kept_of_the_sessions_that_have_ended(station: Station) -> None:
    station.thread.start()
    for number in range(2, 5):
        station.reads()
        Session.trips = [TripError("the field process is lost")]
        until(partial(_has_found, station, number), "it to be read again")
    assert len(station.sessions) == 1


def test_a_rig_whose_devices_are_lost_is_lent_all_the_same(station: Station) -> None:
    Session.connects = [DriverError("daq", "nobody answers", "")] * 10_000
    station.thread.start()
    until(lambda: station.keeper.state == "no devices", "the loss")
    station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    station.keeper.ends(said=True)
    Session.connects = []


def test_nothing_is_obeyed_while_nothing_moves(station: Station) -> None:
    station.thread.start()
    station.reads()
    for name in ("abort", "hold"):
        assert station.obey(Command(name, "local", "", 1)) == NOTHING_MOVES


def test_a_stop_ends_what_waits_for_the_station_to_leave(station: Station) -> None:
    station.keeper.asks()
    assert station.resident._obey(Command("abort", "local", "", 1)) == ""
    assert station.keeper.refused == ["stopped by local before it began"]


def test_a_station_that_ends_while_somebody_drives_lets_him_go_on(station: Station) -> None:
    station.thread.start()
    station.reads()
    station.keeper.asks()
    assert station.keeper.granted.wait(60.0)
    station.stop.request("SIGTERM")
    station.thread.join()
    assert station.kept("left") == ["homing, asked by Bo, goes on by itself"]


@pytest.mark.parametrize("value", [5, "x", [5], {"first_out": [5]}, {"first_out": 5}, None])
@pytest.mark.parametrize("name", ["trips", "unseen", "folder", "acknowledged", "ended_ns"])
def test_a_file_in_which_a_value_is_of_another_type_ends_no_station(
    tmp_path: Path, name: str, value: Any
) -> None:
    kept = {**told(tmp_path, "the stop is open"), "ended_ns": 5, name: value}
    (tmp_path / last_use.LAST).write_text(json.dumps(kept))
    last = LastUse(tmp_path, print)
    last.look()
    last.lent(homing())
    last.acknowledge("ann", "", "")
    assert last.content["campaign"]["name"] == "homing"
