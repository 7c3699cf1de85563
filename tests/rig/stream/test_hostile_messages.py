"""Whatever anybody publishes on a rig's keys, who follows the rig goes on to see it."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from io import StringIO
from typing import Any

import msgpack
import numpy as np
import pytest
import zenoh
from hypothesis import given, settings, strategies as st
from rich.console import Console

from rig.cli.live.monitor import document, line, screen
from rig.console.curves import CHANNELS, Curves
from rig.console.snapshot_sections import sections
from rig.stream.client import StreamClient
from rig.stream.fields import FIELDS, NEEDED
from rig.stream.messages import (
    KINDS,
    Channels,
    MessageError,
    Samples,
    key,
    pack,
    rig_and_kind,
    unpack,
)
from rig.stream.sender import StreamSender
from rig.stream.sessions import publisher_session, subscriber_session
from rig.stream.settings import Endpoint, StreamSettings
from rig.stream.view import RigView
from tests.waiting import until

S = 10**9
HEADER = {"version": 1, "session": "s", "sequence": 0, "sent_ns": 1}
INF, NAN = float("inf"), float("nan")


def good(kind: str) -> dict[str, Any]:
    """Return what a publisher says of a kind."""
    if kind == "samples":
        return Samples(
            1, 0, 1, S, np.linspace(0.0, 2e-3, 3), np.zeros((3, 2), np.float32)
        ).content()
    if kind == "channels":
        return Channels(1, ("position_m", "pressure_1_Pa"), ("m", "Pa")).content()
    if kind == "heartbeat":
        return {"heartbeat_s": 0.5, "sequences": {"samples": 0}, "up_s": 1.0, "rows": 3}
    return {}


JUNK = st.recursive(
    st.one_of(
        st.none(),
        st.booleans(),
        st.integers(-(2**63), 2**64 - 1),
        st.floats(),
        st.text(max_size=5),
        st.binary(max_size=24),
        st.sampled_from([INF, -INF, NAN, 2**63, 2**64 - 1, -(2**63), 1e308]),
        st.just(msgpack.ExtType(5, b"x")),
    ),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4)
    ),
    max_leaves=12,
)  # fmt: skip


@st.composite
def forgeries(draw: st.DrawFn) -> tuple[str, dict[str, Any]]:
    """Return a kind, and a message of it of which anything may be anything."""
    kind = draw(st.sampled_from(KINDS))
    content = {**HEADER, **good(kind)}
    known = [*FIELDS[kind], *HEADER]
    for name in draw(st.lists(st.sampled_from(known) | st.text(max_size=8), max_size=4)):
        content[name] = draw(JUNK)
    for name in draw(st.lists(st.sampled_from(list(content)), max_size=1)):
        del content[name]
    return kind, content


def shown(view: RigView) -> None:
    """Have everything that is known of a rig shown, by all who show it."""
    snapshot = view.snapshot(2 * S)
    json.dumps(document(snapshot), allow_nan=False)
    line(snapshot)
    Console(file=StringIO(), width=100).print(screen(snapshot))
    json.dumps(sections(snapshot), allow_nan=False)
    window = view.window(60.0, CHANNELS)
    curves = Curves()
    curves.take(window, 1e-3)
    json.dumps(curves.since(0), allow_nan=False)


@settings(max_examples=150)
@given(st.lists(forgeries(), min_size=1, max_size=4))
def test_a_message_is_refused_as_such_or_can_be_shown(
    forged: list[tuple[str, dict[str, Any]]],
) -> None:
    view = RigView("bench")
    for kind in ("channels", "samples", "heartbeat"):
        view.take(kind, {**HEADER, **good(kind)}, S)
    for kind, content in forged:
        for take in (view.take, view.take_past):
            try:
                take(kind, unpack(msgpack.packb(content)), S)
            except MessageError:
                continue
    shown(view)


@given(forgeries())
def test_nothing_is_taken_of_a_message_that_is_refused(forged: tuple[str, dict[str, Any]]) -> None:
    view = RigView("bench")
    for kind in ("channels", "samples", "heartbeat"):
        view.take(kind, {**HEADER, **good(kind)}, S)
    before = view.snapshot(S)
    try:
        view.take(forged[0], unpack(msgpack.packb(forged[1])), 2 * S)
    except MessageError:
        assert view.snapshot(S) == before


@pytest.mark.parametrize(
    ("kind", "change"),
    [(kind, {name: value}) for kind in NEEDED for name in NEEDED[kind] for value in (INF, None, "")]
    + [
        ("samples", {"first_row": 1 << 62}),
        ("samples", {"time_s": np.array([0.0, NAN, 1.0]).tobytes()}),
        ("heartbeat", {"sequences": {"samples": INF}}),
        ("heartbeat", {"heartbeat_s": 1e9}),
        ("progress", {"number": "one"}),
        ("health", {"trips": {"first_out": [1]}}),
        ("health", {"timing": {"wakeup": {"p50_s": "long"}}}),
        ("event", {"of a newer publisher": b"bytes"}),
        ("event", {"of a newer publisher": [[[[[[[[[1]]]]]]]]]}),
        ("gossip", {}),
    ],
    ids=str,
)
def test_what_no_publisher_says_is_refused(kind: str, change: dict[str, Any]) -> None:
    with pytest.raises(MessageError):
        RigView("bench").take(kind, {**HEADER, **good(kind), **change}, S)


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_newer_publisher_adds_to_a_message_is_kept(kind: str) -> None:
    view = RigView("bench")
    added = {"added": {"since": [1, 2.5, "x", None, True]}}
    view.take(kind, unpack(pack({**HEADER, **good(kind), **added})), S)
    shown(view)


def test_rows_are_seen_after_a_stranger_spoke_in_between() -> None:
    view = RigView("bench")
    view.take("channels", {**HEADER, **good("channels")}, S)
    view.take("health", {**HEADER, "session": "stranger"}, S)
    view.take("samples", {**HEADER, **good("samples")}, S)
    assert view.window(60.0).row.tolist() == [0, 1, 2]


@pytest.mark.parametrize("rig", ["*", "**", "a b", ""])
def test_a_key_that_names_no_single_rig_is_refused(rig: str) -> None:
    with pytest.raises(MessageError):
        rig_and_kind(f"rig/{rig}/v1/samples")


def test_half_a_character_is_sent_as_one_that_is_not_known() -> None:
    assert unpack(pack({**HEADER, "text": "caf\udce9"}))["text"] == "caf?"


# -- over Zenoh ------------------------------------------------------------------------------------


class Rig:
    """A rig that publishes on loopback, and somebody who may publish there as well."""

    def __init__(self, port: int) -> None:
        self.settings = StreamSettings(listen=(Endpoint("tcp", "127.0.0.1", port),))
        self.rows = 0

    @contextmanager
    def published(self) -> Iterator["Rig"]:
        with publisher_session(self.settings) as session:
            self.sender = StreamSender(session, "bench", 10.0, print)
            self.sender.send("channels", good("channels"))
            yield self
            self.sender.close()

    def publish(self) -> None:
        """Send three rows, and a heartbeat."""
        values = np.zeros((3, 2), np.float32)
        times = 1e-3 * np.arange(self.rows, self.rows + 3, dtype=np.float64)
        self.sender.send("samples", Samples(1, self.rows, 1, S, times, values).content())
        sequences = dict(self.sender.sequences)
        self.sender.send("heartbeat", {"heartbeat_s": 10.0, "sequences": sequences})
        self.rows += 3


@pytest.fixture
def rig(port: int) -> Iterator[Rig]:
    with Rig(port).published() as rig:
        yield rig


@pytest.fixture
def stranger(rig: Rig) -> Iterator[zenoh.Session]:
    with subscriber_session(rig.settings) as session:
        yield session


def goes_on(client: StreamClient, rig: Rig) -> bool:
    """Wait until rows that are sent from now on have come, and the rig counts as alive.

    The token by which it does is sent by another way than rows are, and may come after them. The
    first rows may be lost where others publish at the same time.
    """
    first = rig.rows
    return until(
        lambda: (
            not set(range(first, rig.rows)).isdisjoint(client.window(60.0, rig="bench").row)
            and client.snapshot("bench").alive
        ),
        "rows that were sent now, by a rig that is alive",
        meanwhile=rig.publish,
    )


def forge(stranger: zenoh.Session, kind: str, **change: Any) -> None:
    content = {**HEADER, **good(kind), **change}
    stranger.put(key("bench", kind), msgpack.packb(content))


def test_samples_of_an_infinite_number_of_channels_end_no_reader(
    rig: Rig, stranger: zenoh.Session
) -> None:
    failures: list[str] = []
    with StreamClient(rig.settings, on_failure=failures.append) as client:
        until(client.rigs, "the rig", meanwhile=rig.publish)
        until(
            lambda: client.snapshot().refused,
            "the refusal",
            meanwhile=lambda: forge(stranger, "samples", channels_id=INF),
        )
        assert goes_on(client, rig)
        snapshot = client.snapshot()
    assert snapshot.refusal == "samples with channels_id that cannot be"
    assert (snapshot.session, snapshot.restarts) == (rig.sender.name, 0)
    assert "that are no messages" in line(snapshot)
    assert failures == []


# The first example is the simplest one: a flood of one and the same message.
@settings(max_examples=3, deadline=None)
@given(st.lists(forgeries(), min_size=60, max_size=60))
def test_a_flood_of_forgeries_ends_no_reader(forged: list[tuple[str, dict[str, Any]]]) -> None:
    import socket

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = int(free.getsockname()[1])
    with Rig(port).published() as rig, subscriber_session(rig.settings) as stranger:
        failures: list[str] = []
        with StreamClient(rig.settings, on_failure=failures.append) as client:
            until(client.rigs, "the rig", meanwhile=rig.publish)
            for kind, content in forged:
                stranger.put(key("bench", kind), msgpack.packb(content))
            assert goes_on(client, rig)
        assert failures == []


def test_who_is_called_with_messages_and_fails_is_reported_and_called_again(
    rig: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    called: list[str] = []

    def fails(name: str, kind: str, content: Any) -> None:
        called.append(kind)
        raise ZeroDivisionError("of a script")

    with StreamClient(rig.settings, on_message=fails) as client:
        until(client.rigs, "the rig", meanwhile=rig.publish)
        until(lambda: len(called) > 4, "four calls", meanwhile=rig.publish)
        assert goes_on(client, rig)
        assert client.snapshot().refused == 0
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert "ZeroDivisionError: of a script (test_hostile_messages.py:" in told[0]


def test_a_client_that_cannot_connect_says_so_and_tries_again(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    tries: list[int] = []

    def refused(*_: object) -> zenoh.Session:
        tries.append(1)
        if len(tries) == 1:
            raise PermissionError("no such luck")
        return subscriber_session(rig.settings)

    failures: list[str] = []
    monkeypatch.setattr("rig.stream.client.subscriber_session", refused)
    # By way of a router, a client connects in its thread.
    from dataclasses import replace

    routed = replace(rig.settings, mode="client")
    with StreamClient(routed, on_failure=failures.append) as client:
        until(client.rigs, "the rig", meanwhile=rig.publish)
        assert goes_on(client, rig)
    assert len(failures) == 1
    assert "PermissionError: no such luck" in failures[0]


def test_a_late_joiner_whose_answer_fails_costs_the_next_one_nothing(
    port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    failures: list[str] = []
    settings_ = Rig(port).settings
    with publisher_session(settings_) as session, subscriber_session(settings_) as asking:
        sender = StreamSender(session, "bench", 10.0, failures.append)
        sender.send("state", {"state": "armed"})
        asked_for = sender._asked_for

        def fails_once(query: zenoh.Query) -> dict[str, list[bytes]]:
            monkeypatch.setattr(sender, "_asked_for", asked_for)
            raise OverflowError("of an answer")

        monkeypatch.setattr(sender, "_asked_for", fails_once)
        answers: list[Any] = []
        until(
            lambda: answers,
            "an answer",
            meanwhile=lambda: answers.extend(asking.get(key("bench", "state"), timeout=0.5)),
        )
        sender.close()
    assert unpack(bytes(answers[0].ok.payload))["state"] == "armed"
    assert len(failures) == 1
    assert "OverflowError: of an answer" in failures[0]


@pytest.mark.parametrize(
    "answer", [b"\xff", b"\x93", msgpack.packb({"accepted": "no", "reason": 1})]
)
def test_an_answer_to_a_command_that_is_none_is_not_taken_for_one(
    rig: Rig, stranger: zenoh.Session, answer: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    def replies(query: zenoh.Query) -> None:
        with query:
            query.reply(str(query.key_expr), answer)

    forger = stranger.declare_queryable(key("bench", "command/abort"), replies)
    from rig.stream.commands import Credentials

    mine = Credentials("ann", bytes(32))
    with StreamClient(rig.settings, credentials=mine) as client:
        until(client.rigs, "the rig", meanwhile=rig.publish)
        until(lambda: client.snapshot().session, "the session", meanwhile=rig.publish)
        told = client.send("abort", timeout_s=1.0)
    forger.undeclare()
    assert not told.accepted
    assert told.reason.startswith("no answer")
