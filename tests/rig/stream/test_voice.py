"""On one machine a rig's words are its own: what others say in its name is not taken."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from rig.cli.live.monitor import document, line
from rig.stream.client import StreamClient
from rig.stream.messages import MessageError, command_key, key, pack, unpack
from rig.stream.sender import StreamSender
from rig.stream.sessions import publisher_session, subscriber_session
from rig.stream.settings import Access, Endpoint, StreamSettings
from rig.stream.view import RigView
from rig.stream.voice import Voice, said, voice_of
from tests.waiting import until

KEY = bytes(range(32))
CAMPAIGN = key("bench", "campaign")
HEADER: dict[str, Any] = {"version": 1, "session": "s", "sequence": 0, "sent_ns": 10}
ENDED: dict[str, Any] = {"status": "ended", "name": "forged", "tests": []}


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))


# -- signatures ------------------------------------------------------------------------------------


def test_a_signed_message_is_read_as_any_other() -> None:
    payload = Voice(KEY).signed(CAMPAIGN, {**HEADER, **ENDED})
    content = unpack(payload)
    assert list(content)[-1] == "mac"
    assert len(content.pop("mac")) == 32
    assert content == {**HEADER, **ENDED}
    assert said(content, CAMPAIGN, None) == pack(content)


def test_only_the_same_bytes_on_the_same_key_by_the_same_user_are_said() -> None:
    voice = Voice(KEY)
    payload = voice.signed(CAMPAIGN, HEADER)
    assert voice.said(CAMPAIGN, payload)
    assert not voice.said(key("bench", "state"), payload)
    assert not voice.said(key("other", "campaign"), payload)
    assert not Voice(KEY[::-1]).said(CAMPAIGN, payload)
    for place in range(len(payload)):
        changed = bytearray(payload)
        changed[place] ^= 1
        assert not voice.said(CAMPAIGN, bytes(changed))
    for cut in (b"", payload[:31], payload[:-1], payload + b"x", pack(HEADER)):
        assert not voice.said(CAMPAIGN, cut)


def test_where_access_control_says_who_publishes_nothing_is_signed() -> None:
    local = StreamSettings()
    assert voice_of(local) is not None
    assert voice_of(StreamSettings(access=Access(readers=("anna",)))) is None
    assert voice_of(StreamSettings(listen=(Endpoint("tcp", "192.0.2.1", 7447),))) is None


# -- what a reader takes ---------------------------------------------------------------------------


def hear(view: RigView, *, is_proven: bool, at_ns: int = 0, **content: Any) -> None:
    message = {**HEADER, **ENDED, **content}
    view.admit(message, at_ns, is_proven=is_proven)
    view.take("campaign", message, at_ns)


def test_what_was_said_before_the_rig_was_proven_is_dropped() -> None:
    view = RigView("bench")
    hear(view, is_proven=False, session="x", name="forged")
    assert not view.snapshot(0).proven
    hear(view, is_proven=True, name="true")
    snapshot = view.snapshot(0)
    assert snapshot.proven
    assert (snapshot.campaign["name"], snapshot.session, snapshot.restarts) == ("true", "s", 0)


def test_a_proven_rig_is_not_spoken_for() -> None:
    view = RigView("bench")
    hear(view, is_proven=True, name="true")
    with pytest.raises(MessageError, match="another program speaks in its name"):
        hear(view, is_proven=False, session="x", sequence=7, name="forged")
    assert view.snapshot(0).campaign["name"] == "true"


def test_what_the_rig_said_in_an_earlier_session_is_not_taken_while_it_speaks() -> None:
    view = RigView("bench")
    hear(view, is_proven=True, session="new", sent_ns=100, at_ns=10)
    with pytest.raises(MessageError, match="repeats what the rig said"):
        hear(view, is_proven=True, session="old", sent_ns=50, at_ns=20)
    # A clock that was set back must not keep a reader from the rig's next session for long.
    later_ns = 10 * 10**9
    hear(view, is_proven=True, session="next", sent_ns=60, at_ns=later_ns)
    assert view.session == "next"


def test_an_earlier_word_of_the_same_session_is_not_taken_again() -> None:
    view = RigView("bench")
    for sequence, status in ((3, "running"), (4, "ended")):
        hear(view, is_proven=True, sequence=sequence, status=status)
    with pytest.raises(MessageError, match="repeats what the rig said"):
        hear(view, is_proven=True, sequence=3, status="running")
    assert view.snapshot(0).campaign["status"] == "ended"


def test_two_voices_of_which_none_is_proven_are_told() -> None:
    view = RigView("bench")
    for session in ("one", "two"):
        hear(view, is_proven=False, session=session)
    assert view.snapshot(0).refused == 0
    hear(view, is_proven=False, session="one")
    assert "two programs speak in this rig's name" in view.snapshot(0).refusal


# -- over Zenoh ------------------------------------------------------------------------------------


@pytest.fixture
def settings(port: int) -> StreamSettings:
    return StreamSettings(listen=(Endpoint("tcp", "127.0.0.1", port),), heartbeat_s=0.5)


@pytest.fixture
def rig(settings: StreamSettings) -> Iterator[StreamSender]:
    with publisher_session(settings) as session:
        sender = StreamSender(session, "bench", 30.0, print, voice_of(settings))
        queryable = session.declare_queryable(command_key("bench", "*"), lambda query: None)
        yield sender
        queryable.undeclare()
        sender.close()


@pytest.fixture
def stranger(settings: StreamSettings) -> Iterator[zenoh.Session]:
    with subscriber_session(settings) as session:
        yield session


def speak(rig: StreamSender) -> None:
    content = {"heartbeat_s": 0.5, "sequences": dict(rig.sequences), "rows": 0, "up_s": 1.0}
    rig.send("heartbeat", content)
    rig.send("campaign", {"status": "running", "name": "true", "tests": []})


def test_a_forged_end_of_the_campaign_is_not_shown_and_the_second_voice_is_told(
    rig: StreamSender, stranger: zenoh.Session, settings: StreamSettings
) -> None:
    forged = pack({**HEADER, **ENDED, "sent_ns": time.time_ns()})
    with StreamClient(settings) as client:
        until(client.rigs, "the rig", meanwhile=lambda: speak(rig))
        until(lambda: client.snapshot().proven, "its proof", meanwhile=lambda: speak(rig))
        until(
            lambda: client.snapshot().refused,
            "the forgery",
            meanwhile=lambda: stranger.put(CAMPAIGN, forged),
        )
        snapshot = client.snapshot()
    assert snapshot.campaign["status"] == "running"
    assert snapshot.session == rig.name
    assert "not signed by the rig: another program speaks in its name" in snapshot.refusal
    assert "another program speaks in its name" in line(snapshot)
    assert document(snapshot)["proven"]


def test_an_answer_that_the_rig_did_not_sign_is_not_believed(
    rig: StreamSender, stranger: zenoh.Session, settings: StreamSettings
) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply(str(query.key_expr), pack({"accepted": True, "reason": ""}))

    forger = stranger.declare_queryable(command_key("bench", "*"), answer)
    with StreamClient(settings) as client:
        until(client.rigs, "the rig", meanwhile=lambda: speak(rig))
        until(lambda: client.snapshot().proven, "its proof", meanwhile=lambda: speak(rig))

        def refused() -> bool:
            """Whether an answer was refused; the forger may not be reached at first."""
            got = client.send("abort", timeout_s=1.0)
            assert not got.accepted
            assert "no answer" in got.reason
            return client.snapshot().refused > 0

        until(refused, "the forged answer")
        assert "an answer not signed by the rig" in client.snapshot().refusal
    forger.undeclare()
