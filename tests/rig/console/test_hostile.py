"""Whoever wants the console to fail, or the operators to be kept from it, does not succeed."""

import contextlib
import http.client
import json
import socket
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

from rig.console import running
from rig.console.curves import CURVES, Curves
from rig.console.guard import MOST_PER_S, Refusals
from rig.console.launcher import Launcher, Offer, Served
from rig.console.orders import MalformedError, Order, Orders, parse
from rig.console.visitors import ControlHolder, Visitor
from rig.stream.answers import Answer
from rig.stream.known import Snapshot

from .fakes import RUNNING, FakeClient, start_by, until
from .site import TOKEN, Site

ANNA, BEN = Visitor(1, "Anna", 9e9), Visitor(2, "Ben", 9e9)


class Started:
    """A process that goes on until it is stopped, and took its time to begin."""

    def __init__(self, count: list["Started"]) -> None:
        time.sleep(0.05)
        self.signals: list[int] = []
        count.append(self)

    def poll(self) -> None:
        return None

    def send_signal(self, number: int) -> None:
        self.signals.append(number)


@pytest.fixture
def started() -> list[Started]:
    return []


@pytest.fixture
def launcher(tmp_path: Path, started: list[Started], monkeypatch: pytest.MonkeyPatch) -> Launcher:
    def popen(*_: Any, **__: Any) -> Any:
        return Started(started)

    served = Served((Offer("a", "a", "", "other", 1),), tmp_path, "loopback")
    start_by(monkeypatch, popen)
    return Launcher(served, lambda text: None)


def desk(client: FakeClient, launcher: Launcher, tell: Any = lambda text: None) -> Orders:
    control = ControlHolder(tell)
    control.take(ANNA)
    return Orders(client, control, launcher)


def all_at_once(*jobs: Any) -> list[Any]:
    """Return what came of jobs that begin together."""
    ready = threading.Barrier(len(jobs))
    found: list[Any] = [None] * len(jobs)

    def run(k: int) -> None:
        ready.wait(30)
        found[k] = jobs[k]()

    threads = [threading.Thread(target=run, args=(k,)) for k in range(len(jobs))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


# ---- two at once --------------------------------------------------------------------------------


def test_two_starts_at_once_start_one(launcher: Launcher, started: list[Started]) -> None:
    orders = desk(FakeClient(RUNNING), launcher)
    start = lambda: orders.carry_out(Order("start", name="a"), ANNA).accepted  # noqa: E731
    assert sorted(all_at_once(start, start, start)) == [False, False, True]
    assert len(started) == 1


def slow_clock() -> int:
    time.sleep(0.02)
    return 1


def test_of_two_who_take_control_at_once_one_is_refused(launcher: Launcher) -> None:
    control = ControlHolder(lambda text: None, slow_clock)
    orders = Orders(FakeClient(RUNNING), control, launcher)
    take = [lambda who=who: orders.carry_out(Order("take"), who).accepted for who in (ANNA, BEN)]
    assert sorted(all_at_once(*take)) == [False, True]


def test_a_rig_given_for_all_campaigns_is_looked_at_before_one_is_started(
    launcher: Launcher, tmp_path: Path, started: list[Started]
) -> None:
    offers = (Offer("a", "a", "", "other", 1),)
    launcher = Launcher(Served(offers, tmp_path, "loopback", "rigs/bench.yaml"), print)
    answer = desk(FakeClient(RUNNING), launcher).carry_out(Order("start", name="a"), ANNA)
    assert (answer.reason, started) == ("bench has a campaign running", [])


# ---- stop ---------------------------------------------------------------------------------------


class Broken(FakeClient):
    """A stream whose session has failed."""

    def send(self, *_: Any, **__: Any) -> Answer:
        raise RuntimeError("session closed")


def test_a_stream_that_fails_leaves_the_other_way_to_stop(
    launcher: Launcher, started: list[Started]
) -> None:
    orders = desk(Broken(RUNNING), launcher)
    assert orders.carry_out(Order("stop", "bench"), BEN) == Answer(False, "session closed")
    orders.carry_out(Order("start", name="a"), ANNA)
    assert orders.carry_out(Order("stop", "other"), BEN).accepted
    assert len(started[0].signals) == 1


def test_a_stop_is_not_called_obeyed_because_another_rig_was_stopped(
    launcher: Launcher, started: list[Started]
) -> None:
    client = FakeClient(RUNNING)
    orders = desk(client, launcher)
    orders.carry_out(Order("start", name="a"), ANNA)
    told = {"status": "running", "directory": launcher.under_way()}
    client.shots["other"] = Snapshot(rig="other", alive=True, campaign=told)
    client.answer = Answer(False, "no answer")
    answer = orders.carry_out(Order("stop", "bench"), ANNA)
    assert not answer.accepted
    assert "on other, was interrupted" in answer.reason
    assert len(started[0].signals) == 1
    assert orders.carry_out(Order("stop", "other"), ANNA).accepted


def test_a_stop_before_the_rig_that_was_started_is_heard_stops_the_shown_one_and_it(
    launcher: Launcher, started: list[Started]
) -> None:
    client = FakeClient(RUNNING)
    orders = desk(client, launcher)
    orders.carry_out(Order("start", name="a"), ANNA)
    assert orders.rig_of_run(launcher.under_way()) == ""
    answer = orders.carry_out(Order("stop", "bench"), ANNA)
    assert answer.accepted
    assert "was interrupted" in answer.reason
    assert len(started[0].signals) == 1
    # Once its rig is known, a stop is for the rig that the page shows, and for no other.
    told = {"status": "running", "directory": launcher.under_way(), "begun_ns": time.time_ns()}
    client.shots["other"] = Snapshot(rig="other", alive=True, campaign=told)
    assert orders.rig_of_run(launcher.under_way()) == "other"
    assert orders.carry_out(Order("stop", "bench"), ANNA).accepted
    assert len(started[0].signals) == 1


def test_a_stop_right_after_a_reset_stops_the_shown_rig_and_the_run_that_goes_on(
    launcher: Launcher, started: list[Started], tmp_path: Path
) -> None:
    """What was heard of the run is from before it was stopped: nobody has heard it go on."""
    (tmp_path / "night").mkdir()
    (tmp_path / "night" / "journal.jsonl").write_text('{"kind": "begin", "campaign": "a"}\n')
    told = {"status": "ended", "directory": "night", "begun_ns": time.time_ns()}
    other = Snapshot(rig="other", age_s=9.0, campaign=told)
    client = FakeClient(replace(RUNNING, alive=False), other)
    orders = desk(client, launcher)
    assert orders.carry_out(Order("go on", name="night"), ANNA).accepted
    client.become("bench", alive=True)
    answer = orders.carry_out(Order("stop", "bench"), ANNA)
    assert answer.accepted
    assert client.sent == [("abort", "bench", "Anna", "")]
    assert "was interrupted" in answer.reason
    assert len(started[0].signals) == 1
    client.become("other", alive=True, campaign=told | {"begun_ns": time.time_ns()})
    assert orders.carry_out(Order("stop", "bench"), ANNA) == Answer(True)
    assert len(started[0].signals) == 1


def test_a_stop_of_a_silent_rig_is_not_called_obeyed_because_a_run_on_another_was_interrupted(
    launcher: Launcher, started: list[Started]
) -> None:
    client = FakeClient(RUNNING)
    orders = desk(client, launcher)
    orders.carry_out(Order("start", name="a"), ANNA)
    client.answer = Answer(False, "no answer")
    answer = orders.carry_out(Order("stop", "bench"), ANNA)
    assert not answer.accepted
    assert answer.reason == "no answer; what was started here, on other, was interrupted"
    assert len(started[0].signals) == 1


def test_a_stop_by_a_page_that_was_told_of_no_rig_is_for_the_one_that_lives(site: Site) -> None:
    who = site.cookie()
    status, answer = site.order(who, order="stop")
    assert (status, answer["reason"]) == (200, "on bench, the only one that lives")
    assert site.client.sent == [("abort", "bench", "Anna", "")]
    site.client.shots["other"] = Snapshot(rig="other", alive=True)
    status, answer = site.order(who, order="stop")
    assert (status, answer["reason"]) == (409, "name the rig; alive are: bench, other")


def test_a_stop_does_not_wait_for_other_orders(site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    held = threading.Event()
    send = site.client.send

    def slow(command: str, *told: Any, **more: Any) -> Answer:
        if command == "hold":
            held.wait(30)
        return send(command, *told, **more)

    monkeypatch.setattr(site.client, "send", slow)
    who = site.cookie()
    site.order(who, order="take")
    holds = [
        threading.Thread(target=site.order, args=(who,), kwargs={"order": "hold", "rig": "bench"})
        for _ in range(40)
    ]
    for hold in holds:
        hold.start()
    try:
        assert site.order(who, order="stop", rig="bench")[0] == 200
        assert site.client.sent == [("abort", "bench", "Anna", "")]
    finally:
        held.set()
        for hold in holds:
            hold.join()


# ---- what is shown ------------------------------------------------------------------------------


@pytest.mark.parametrize("key", ["rig", "name", "text"])
def test_half_a_character_is_refused(key: str) -> None:
    # It could be sent to no viewer, and would end the view of all of them.
    with pytest.raises(MalformedError, match="no text"):
        parse(json.dumps({"order": "stop", key: "\ud800"}).encode())
    assert parse(json.dumps({"order": "stop", key: "\U0001f6d1"}).encode())


@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 1e13, 3e38])
def test_samples_that_cannot_be_are_not_drawn(value: float) -> None:
    client = FakeClient(RUNNING)
    window = client.window(0.02)
    window.values["position_m"][:] = value
    curves = Curves()
    curves.take(window, 1e-3)
    shown = curves.since(0)
    assert shown is not None
    assert set(CURVES) < set(shown)
    assert set(shown["position_mm"]) == {None}
    json.dumps(shown, allow_nan=False)


# ---- connections --------------------------------------------------------------------------------


def idle(site: Site, told: bytes = b"") -> socket.socket:
    """Return a connection whose request is never complete."""
    connection = socket.create_connection(("127.0.0.1", site.port), timeout=30)
    connection.sendall(told)
    return connection


def is_closed(connection: socket.socket) -> bool:
    """Wait until a connection is closed from the other side."""
    with connection:
        try:
            while connection.recv(1000):
                pass
        except ConnectionResetError:
            pass
    return True


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(running, "MOST_CONNECTIONS", 8)
    return 8


@pytest.mark.parametrize("told", ["", "GET / HT", "POST /login HTTP/1.1\r\n{}\r\nx"])
def test_connections_that_send_no_request_keep_no_operator_out(
    site: Site, few: int, told: str
) -> None:
    host = f"127.0.0.1:{site.port}"
    head = f"Host: {host}\r\nOrigin: http://{host}\r\nContent-Length: 9\r\n"
    held = [idle(site, told.format(head).encode()) for _ in range(3 * few)]
    who = site.cookie()
    with site.live(who):
        held += [idle(site) for _ in range(3 * few)]
        assert site.order(who, order="stop", rig="bench")[0] == 200
    assert is_closed(held[0])
    for each in held:
        each.close()


def test_views_that_were_refused_and_stay_keep_no_operator_out(
    site: Site, few: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The server itself would give up waiting for the other side to close, sooner or later.
    never = property(lambda _: 3600.0, lambda *_: None)
    monkeypatch.setattr(WebSocketsSansIOProtocol, "close_timeout", never, raising=False)
    host = f"127.0.0.1:{site.port}"
    request = (
        f"GET /live HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    with contextlib.ExitStack() as stack:
        held = [stack.enter_context(idle(site, request.encode())) for _ in range(3 * few)]
        refused = [is_refused(each) for each in held]
        assert site.order(site.cookie(), order="stop", rig="bench")[0] == 200
        stay = [each for each, was in zip(held, refused, strict=True) if was and not is_gone(each)]
        assert len(stay) < few


def is_refused(view: socket.socket) -> bool:
    """Wait for the end of a view: by a websocket's closing (True), or by the connection's."""
    answer = b""
    with contextlib.suppress(ConnectionResetError):
        while b"\r\n\r\n\x88" not in answer:
            more = view.recv(1000)
            if not more:
                return False
            answer += more
        return True
    return False


def is_gone(connection: socket.socket) -> bool:
    """Return whether the other side has closed a connection of which all was read."""
    connection.setblocking(False)
    try:
        return not connection.recv(1000)
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_a_request_that_takes_too_long_is_ended(
    site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "REQUEST_S", 0.1)
    assert is_closed(idle(site))
    assert is_closed(idle(site, b"GET / HTTP/1.1\r\nHost: "))
    monkeypatch.undo()
    assert site.log_in().status == 303


def test_who_goes_away_amid_a_request_leaves_no_traceback(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    host = f"127.0.0.1:{site.port}"
    head = f"POST /login HTTP/1.1\r\nHost: {host}\r\nOrigin: http://{host}\r\n"
    idle(site, f"{head}Content-Length: 9\r\n\r\nx".encode()).close()
    until(lambda: site.is_logged("login: "), "the log")
    fields = urlencode([("token", TOKEN)] * 9)
    assert site.ask("POST", "/login", fields).status == 403
    assert [record for record in caplog.records if record.exc_info] == []


def test_a_flood_of_refusals_does_not_fill_the_log(monkeypatch: pytest.MonkeyPatch) -> None:
    log: list[str] = []
    now = [0.0]
    monkeypatch.setattr("rig.console.guard.time", SimpleNamespace(monotonic=lambda: now[0]))
    refusals = Refusals(log.append)
    for _ in range(1000):
        refusals("a", "login")
    assert log == ["refused, from a: login"] * MOST_PER_S
    now[0] = 1.5
    refusals.look()
    assert log[MOST_PER_S:] == [f"refused: {1000 - MOST_PER_S} more, not told one by one"]
    refusals("b", "name")
    assert log[-1] == "refused, from b: name"


@pytest.mark.parametrize("host", ["{}.", "LOCALHOST.", "[::ffff:127.0.0.1]", "127.1", "2130706433"])
def test_other_spellings_of_this_machine_are_no_names_of_the_console(site: Site, host: str) -> None:
    told = f"{host.format('127.0.0.1')}:{site.port}"
    assert site.ask("GET", "/login", headers={"Host": told}).status == 421
    assert site.ask("GET", "/login", headers={"Host": f"LocalHost:{site.port}"}).status == 200


def test_two_names_in_one_request_are_refused(site: Site) -> None:
    connection = http.client.HTTPConnection("127.0.0.1", site.port, timeout=30)
    connection.putrequest("GET", "/login")
    connection.putheader("Host", "evil.example")
    connection.endheaders()
    assert connection.getresponse().status in (400, 421)
    connection.close()


def test_who_sent_it_on_is_not_believed(site: Site) -> None:
    site.ask("POST", "/login", "token=guess&name=Eve", {"X-Forwarded-For": "10.1.2.3"})
    assert site.is_logged("refused, from 127.0.0.1: login")
