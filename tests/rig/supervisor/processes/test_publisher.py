"""The publisher sends what the ring holds, obeys nobody it does not know, and is never missed."""

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path
from typing import Any, cast
from unittest.mock import MagicMock

import msgpack
import numpy as np
import pytest
import zenoh

from rig.loop.board import Word
from rig.loop.interlocks.ladder import Cause
from rig.stream.answers import Answer
from rig.stream.client import StreamClient
from rig.stream.commands import LARGEST_COMMAND, Command, Credentials, Sender, seal
from rig.stream.messages import command_key
from rig.stream.sessions import publisher_session, subscriber_session
from rig.stream.settings import Operator
from rig.supervisor.processes import publisher as publisher_module, streaming
from rig.supervisor.processes.publisher import REFUSALS_REPORTED, Obeyed, Open, Publisher
from rig.supervisor.processes.streaming import RowFeed, Stream
from tests.rig.supervisor.processes.streamed_rig import CHANNELS, Bench
from tests.waiting import PATIENCE_S, until


def texts(client: StreamClient) -> list[str]:
    return [event["text"] for event in client.snapshot("bench").events]


def until_reached(sender: Any) -> None:
    """Wait until what a querier asks, or a publisher puts, comes to somebody."""
    until(lambda: sender.matching_status.matching, f"somebody at {sender.key_expr}")


@contextmanager
def stranger(bench: Bench, asked: str) -> Iterator[zenoh.Session]:
    """Open a session by tools of one's own, whose questions on a key reach the rig."""
    with subscriber_session(bench.settings) as session:
        until_reached(session.declare_querier(asked))
        yield session


def ask(bench: Bench, name: str, payload: bytes | None) -> Answer:
    """Send any payload on the key of a command, as somebody with tools of his own would."""
    with stranger(bench, command_key("bench", name)) as session:
        for reply in session.get(command_key("bench", name), payload=payload, timeout=PATIENCE_S):
            told = msgpack.unpackb(bytes(reply.ok.payload)) if reply.ok else {}
            return Answer(bool(told.get("accepted")), str(told.get("reason")))
    return Answer(False, "no answer")


def test_rows_arrive_whole_in_order_and_named(bench: Bench, client: StreamClient) -> None:
    bench.stream.columns(1, ("time_s", "way_m", "wakeup_s", "segment"), 7)
    # The publisher takes one order after the other.
    bench.stream.event("test", "note", "columns told")
    until(lambda: "columns told" in texts(client), "the columns to be sent")
    bench.write(1010)
    until(lambda: len(client.window(60.0).row) == 1010)
    window = client.window(60.0)
    np.testing.assert_array_equal(window.row, np.arange(1010))
    np.testing.assert_array_equal(window.values["way_m"], np.arange(1010))
    np.testing.assert_array_equal(window.time_s, np.arange(1010) * 1e-3)
    assert set(window.test) == {7}
    # Zenoh may drop messages on a busy machine, whose rows the client then asks for.
    assert "rows" not in client.snapshot().missing
    assert dict(zip(client.snapshot().names, client.snapshot().units, strict=True))["way_m"] == "m"


def test_who_joins_late_gets_what_was_before(bench: Bench, client: StreamClient) -> None:
    bench.stream.send("state", {"state": "armed", "since_ns": 1})
    bench.stream.event("test", "verdict", "healthy", 1.0)
    bench.write(500)
    until(lambda: len(client.window(60.0).row) == 500)
    with StreamClient(bench.settings) as late:
        until(lambda: late.rigs() and len(late.window(60.0).row) == 500)
        until(lambda: "healthy" in texts(late))
        assert late.snapshot().state["state"] == "armed"
        assert late.snapshot().missing == {}


def test_a_killed_publisher_is_started_again_and_misses_no_row(
    bench: Bench, client: StreamClient
) -> None:
    bench.stream.send("state", {"state": "running"})
    bench.write(100)
    until(lambda: len(client.window(60.0).row) == 100)
    first = client.snapshot().session
    os.kill(bench.pid or 0, signal.SIGKILL)
    bench.write(400)
    until(lambda: client.snapshot().alive and client.snapshot().session != first)
    until(lambda: len(client.window(60.0).row) == 500)
    snapshot = client.snapshot()
    assert (snapshot.restarts, snapshot.missing) == (1, {})
    assert snapshot.state["state"] == "running"
    until(lambda: any("SIGKILL" in text for text in texts(client)))
    until(lambda: any("SIGKILL" in said for said in bench.said))


def test_rows_that_a_publisher_took_and_did_not_send_are_left_to_the_next_one(
    tmp_path: Path, port: int
) -> None:
    bench = Bench(tmp_path, port)
    ours, theirs = Pipe()
    with ours, theirs, publisher_session(bench.settings) as session:
        order = Open(bench.settings, "bench", CHANNELS)
        publisher = Publisher(bench.board, theirs, order, session)
        publisher._flushed_at = time.monotonic() + 60.0
        bench.write(25)
        publisher._take_turn()
        # A batch has 20 rows, and 5 are left.
        assert bench.board.words[Word.PUBLISHED] == 20
        publisher._sender.close()
    os.close(bench.board.fd)


def test_a_hung_publisher_holds_nobody_up(
    bench: Bench, client: StreamClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(streaming, "SILENCE_S", 1.0)
    pid = bench.pid or 0
    os.kill(pid, signal.SIGSTOP)
    for k in range(5000):
        bench.stream.event("test", "note", f"{k}" * 50)
    until(lambda: not client.snapshot().alive, "the stream to be dead")
    until(lambda: any("hung" in said for said in bench.said), "the hang to be reported")
    until(lambda: bench.pid not in (None, pid) and client.snapshot().alive)


def test_a_genuine_command_is_obeyed_and_answered(bench: Bench, client: StreamClient) -> None:
    until(lambda: client.snapshot().proven, "the stream to be signed")
    assert client.send("abort", text="oil on the floor") == Answer(True)
    assert [(c.name, c.by, c.text) for c in bench.commands] == [
        ("abort", "ann", "oil on the floor")
    ]
    bench.refusal = "nothing runs"
    assert client.send("hold") == Answer(False, "nothing runs")
    until(lambda: any("hold by ann not obeyed: nothing runs" in text for text in texts(client)))
    client.send("hold", text="Ada: lunch", person="Ada")
    until(lambda: any("Ada (ann) not obeyed: nothing" in text for text in texts(client)))
    # One event each: of a stop that had two, a reader would take the rig for stopped twice.
    assert texts(client) == [
        "abort by ann obeyed: oil on the floor",
        "hold by ann not obeyed: nothing runs",
        "hold by Ada (ann) not obeyed: nothing runs: lunch",
    ]


def test_a_command_that_is_answered_late_says_so_in_its_events(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher_module, "ANSWER_S", 0.0)
    ours, theirs = Pipe()
    with ours, theirs, publisher_session(bench.settings) as session:
        publisher = Publisher(bench.board, theirs, Open(bench.settings, "bench", CHANNELS), session)
        command = Command("abort", "ann", "", 7)
        query = cast(Any, MagicMock())
        told: list[str] = []
        publisher._event = lambda kind, text: told.append(text)  # type: ignore[method-assign]
        publisher._waiting[7] = (query, command, 0.0)
        publisher._send_due()
        publisher._obey(Obeyed(7, ""))
        publisher._sender.close()
    assert told == [
        "abort by ann not answered within 0 s, and may be obeyed later",
        "abort by ann obeyed late",
    ]


def unsigned(bench: Bench, session: str) -> bytes:
    return Sender(Credentials("nobody", bytes(32))).sign("bench", session, "abort")


def forged(bench: Bench, session: str) -> bytes:
    genuine = msgpack.unpackb(signed(bench, session))
    body = msgpack.unpackb(genuine["body"])
    return bytes(
        msgpack.packb(
            {**genuine, "body": msgpack.packb({**body, "sequence": body["sequence"] + 1})}
        )
    )


def signed(bench: Bench, session: str) -> bytes:
    return Sender(Credentials("ann", bench.key)).sign("bench", session, "abort")


Make = Callable[[Bench, str], bytes | None]
NOT_GENUINE: tuple[tuple[str, Make], ...] = (
    ("unauthenticated", unsigned),
    ("forged", forged),
    ("replayed", lambda bench, session: signed(bench, "an earlier one")),
)
NO_COMMANDS: tuple[tuple[str, Make], ...] = (
    ("malformed", lambda bench, session: b"\xff" * 100),
    ("malformed", lambda bench, session: None),
    ("oversized", lambda bench, session: bytes(LARGEST_COMMAND + 1)),
)


@pytest.mark.parametrize("commands", [NOT_GENUINE, NO_COMMANDS], ids=["not genuine", "none"])
def test_a_command_that_is_not_to_be_obeyed_is_refused_and_logged(
    bench: Bench, client: StreamClient, commands: tuple[tuple[str, Make], ...]
) -> None:
    # Each of so few is reported, though they come within a second.
    assert len(commands) < REFUSALS_REPORTED
    refused: list[str] = []
    for why, make in commands:
        answer = ask(bench, "abort", make(bench, client.snapshot().session))
        assert not answer.accepted
        assert answer.reason.startswith(why)
        refused.append(f"command refused, {why}")
        for each in refused:
            assert bench.log.count(each) == refused.count(each)
    until(
        lambda: all(
            sum(each in text for text in texts(client)) == refused.count(each) for each in refused
        ),
        "all to be reported",
    )
    assert bench.commands == []


def test_a_replayed_command_is_refused_and_logged(bench: Bench, client: StreamClient) -> None:
    payload = signed(bench, client.snapshot().session)
    assert ask(bench, "abort", payload).accepted
    assert ask(bench, "abort", payload).reason.startswith("replayed")
    assert len(bench.commands) == 1
    assert "command refused, replayed" in bench.log


def test_a_command_that_wants_no_answer_is_refused_and_logged(
    bench: Bench, client: StreamClient
) -> None:
    payload = signed(bench, client.snapshot().session)
    with subscriber_session(bench.settings) as session:
        until(
            lambda: "command refused, unanswerable" in bench.log,
            meanwhile=lambda: session.put(command_key("bench", "abort"), payload),
        )
    assert bench.commands == []


def test_a_flood_of_forgeries_fills_no_log_and_stops_nothing(
    bench: Bench, client: StreamClient
) -> None:
    key, begun = command_key("bench", "abort"), time.monotonic()
    with stranger(bench, key) as session:
        for _ in range(600):
            session.get(key, lambda reply: None, payload=b"x" * 50)
        until(lambda: "command refused" in bench.log)
    bench.write(100)
    until(lambda: len(client.window(60.0).row) == 100)
    assert until(lambda: client.send("abort").accepted)
    # So many in any second.
    assert len(bench.log.splitlines()) <= REFUSALS_REPORTED * (time.monotonic() - begun + 1.0)


def test_a_flood_of_questions_delays_only_who_asks(bench: Bench, client: StreamClient) -> None:
    bench.write(1000)
    until(lambda: len(client.window(60.0).row) == 1000)
    asked = ("?last=1e300", "?last=-1", "?last=nan", "?last=x;last=y", "")
    with stranger(bench, "rig/bench/v1/*") as session:
        for k in range(400):
            session.get("rig/bench/v1/*" + asked[k % len(asked)], lambda reply: None)
        bench.write(100)
        until(lambda: len(client.window(60.0).row) == 1100)
    assert client.snapshot().missing == {}
    assert client.snapshot().restarts == 0


def test_nonsense_on_a_stream_s_keys_is_left_aside(bench: Bench, client: StreamClient) -> None:
    with subscriber_session(bench.settings) as session:
        until_reached(session.declare_publisher("rig/bench/v1/samples"))
        for payload in (b"", b"\xff" * 50, b"\x91" * 100_000, bytes(2 << 20)):
            for kind in ("samples", "heartbeat", "alive/x", "nothing"):
                session.put(f"rig/bench/v1/{kind}", payload)
        bench.write(100)
        until(lambda: len(client.window(60.0).row) == 100)
    assert client.rigs() == ("bench",)
    assert client.snapshot().missing == {}


def test_more_than_a_publisher_takes_reaches_nobody(bench: Bench, client: StreamClient) -> None:
    key = command_key("bench", "abort")
    with stranger(bench, key) as session:
        session.get(key, lambda reply: None, payload=bytes(10_000_000))
        bench.write(100)
        until(lambda: len(client.window(60.0).row) == 100)
    assert bench.commands == []
    assert client.snapshot().restarts == 0


def test_health_tells_the_first_cause_of_a_trip(bench: Bench, client: StreamClient) -> None:
    words = bench.board.words
    now = time.monotonic_ns()
    words[Word.LOOP_BEAT] = now
    words[Word.FIELD_TRIP_AT], words[Word.FIELD_TRIP] = now + 10**6, Cause.BYPASS_LOST
    words[Word.LOOP_TRIP_AT], words[Word.LOOP_TRIP] = now, Cause.ESTOP_OPEN
    bench.write(100)
    until(lambda: client.snapshot().health.get("trips"))
    health = until(lambda: (h := client.snapshot().health)["timing"] and h)
    first, second = health["trips"]["first_out"]
    assert (first["by"], first["cause"]) == ("loop", "ESTOP_OPEN")
    assert (second["by"], second["after_s"]) == ("field", pytest.approx(1e-3))
    assert health["timing"]["wakeup"]["p50_s"] == pytest.approx(2e-5)
    assert "loop" in health["silent_s"]


def test_a_rig_that_ends_is_dead_at_once(tmp_path: Path, port: int) -> None:
    bench = Bench(tmp_path, port)
    bench.stream.attach(bench.board, CHANNELS)
    with StreamClient(replace(bench.settings, heartbeat_s=5.0)) as client:
        client.wait_for_rig(PATIENCE_S)
        bench.stream.close()
        until(lambda: not client.snapshot().alive)
    os.close(bench.board.fd)


def test_a_stream_that_cannot_be_opened_is_reported_and_the_run_goes_on(tmp_path: Path) -> None:
    bench = Bench(tmp_path, 0)
    missing = Operator("ann", ("abort",), tmp_path / "none.key")
    said: list[str] = []
    settings = replace(bench.settings, operators=(missing,))
    stream = Stream(settings, "bench", tmp_path / "log", said.append, bench.on_command)
    stream.attach(bench.board, CHANNELS)
    until(lambda: said)
    assert "none.key" in said[0]
    assert "goes on without" in said[0]
    stream.close()
    os.close(bench.board.fd)


@pytest.mark.parametrize("live", [True, False])
def test_a_simulated_rig_is_shown_with_what_is_left_out_counted(
    tmp_path: Path, port: int, live: bool
) -> None:
    bench = Bench(tmp_path, port)
    feed = RowFeed(bench.stream, ("time_s", "position_m"), live=live)
    with StreamClient(bench.settings) as client:
        client.wait_for_rig(PATIENCE_S)
        for first in range(0, 5000, 500):
            numbers = np.arange(first, first + 500.0)
            feed.add(np.column_stack([numbers * 1e-3, numbers]), 1)
            time.sleep(0.05)
        last = 4999
        until(lambda: client.rigs() and client.snapshot().latest.get("position_m") == last)
        window = client.window(60.0)
        np.testing.assert_array_equal(window.values["position_m"], window.row)
        assert client.snapshot().missing.get("rows", 0) == (
            0 if live else 5000 - len(window.row) - 300
        )
        assert "row" not in client.snapshot().names
    bench.stream.close()
    feed.close()
    os.close(bench.board.fd)


def test_a_subscriber_of_zenoh_alone_sees_the_keys(bench: Bench) -> None:
    seen: set[str] = set()
    with (
        subscriber_session(bench.settings) as session,
        session.declare_subscriber("rig/bench/v1/*", lambda sample: seen.add(str(sample.key_expr))),
    ):
        until(lambda: {"rig/bench/v1/heartbeat", "rig/bench/v1/samples"} <= seen,
              meanwhile=lambda: bench.write(20))  # fmt: skip


def test_a_command_that_cannot_be_obeyed_is_answered_and_the_next_one_obeyed(
    bench: Bench, client: StreamClient, monkeypatch: pytest.MonkeyPatch
) -> None:
    obey = bench.stream._on_command

    def fails(command: Command) -> str:
        bench.stream._on_command = obey
        raise OSError("no space left")

    bench.stream._on_command = fails
    answer = client.send("hold")
    assert not answer.accepted
    assert "OSError: no space left" in answer.reason
    assert client.send("abort").accepted
    assert [command.name for command in bench.commands] == ["abort"]


def test_an_operator_s_screen_that_is_gone_keeps_no_command_from_the_rig(
    bench: Bench, client: StreamClient
) -> None:
    def gone(line: str) -> None:
        raise BrokenPipeError

    bench.stream._say = gone
    assert client.send("abort").accepted
    assert client.send("hold").accepted


def test_what_cannot_be_sent_is_left_out_and_the_rest_is_sent(
    bench: Bench, client: StreamClient
) -> None:
    first = client.snapshot().session
    bench.stream.send("event", {"text": threading.Lock()})  # no process can be sent one
    bench.stream.send("event", {"text": complex(1, 1)})  # and no message holds one
    bench.stream.event("test", "note", "caf\udce9")
    until(lambda: "caf?" in texts(client))
    assert any("TypeError" in said for said in bench.said)
    until(lambda: any("TypeError" in text for text in texts(client)))
    assert client.snapshot().session == first


def test_a_command_whose_text_is_no_utf_8_is_refused(bench: Bench, client: StreamClient) -> None:
    for text in (b"caf\xe9", "\ud83d".encode("utf-8", "surrogatepass")):
        marker = b"TEXT"[: len(text)]
        sender = Sender(Credentials("ann", bench.key))
        sealed = msgpack.unpackb(
            sender.sign("bench", client.snapshot().session, "abort", marker.decode())
        )
        body = sealed["body"].replace(marker, text)
        assert body != sealed["body"]
        answer = ask(bench, "abort", seal(Credentials("ann", bench.key), body))
        assert not answer.accepted
        assert answer.reason.startswith("malformed")
        assert bench.commands == []
    assert client.send("hold").accepted


def test_a_watch_of_the_publisher_that_fails_starts_another_one(
    tmp_path: Path, port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench = Bench(tmp_path, port)
    publish = Stream._publish

    def fails(stream: Stream, note: str) -> Any:
        monkeypatch.setattr(Stream, "_publish", publish)
        raise ZeroDivisionError("of the safety thread")

    monkeypatch.setattr(Stream, "_publish", fails)
    bench.stream.attach(bench.board, CHANNELS)
    with StreamClient(bench.settings) as client:
        client.wait_for_rig(PATIENCE_S)
        until(lambda: any("ZeroDivisionError" in said for said in bench.said))
    bench.stream.close()
    os.close(bench.board.fd)


def test_until_the_ram_is_homed_its_count_is_no_position_and_its_command_no_setpoint(
    bench: Bench, client: StreamClient
) -> None:
    bench.board.words[Word.HOMED] = 0
    bench.write(50, segment=1)
    until(lambda: "encoder_m" in client.window(60.0).values, "the encoder's count")
    assert "position_m" not in client.window(60.0).values
    bench.board.words[Word.HOMED] = 1
    bench.write(50, segment=2)
    until(lambda: len(client.window(60.0).row) == 100, "the rows after homing")
    position = client.window(60.0, ("position_m",)).values["position_m"]
    assert np.isnan(position[:50]).all()
    np.testing.assert_array_equal(position[50:], np.arange(50, 100))
