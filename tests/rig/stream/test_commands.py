"""Only commands that are genuine, fresh, allowed and for this rig's present session are obeyed."""

import os
from pathlib import Path

import msgpack
import pytest
from hypothesis import given, strategies as st

from rig.stream.commands import (
    KEY_BYTES,
    LARGEST_COMMAND,
    SENDERS_KEPT,
    WINDOW_S,
    Credentials,
    Gate,
    KeyFileError,
    Refused,
    Sender,
    gate_of,
    make_key,
    own_key,
    read_key,
    seal,
)
from rig.stream.settings import Operator, StreamSettings

KEY = bytes(range(KEY_BYTES))
ANN = Credentials("ann", KEY)
NOW = 10**18


class Clock:
    """A wall clock that stands still unless it is moved."""

    def __init__(self) -> None:
        self.now_ns = NOW

    def time_ns(self) -> int:
        return self.now_ns


@pytest.fixture(autouse=True)
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr("rig.stream.commands.time", clock)
    return clock


@pytest.fixture
def gate() -> Gate:
    return Gate("bench", "s1", {"ann": (ANN, frozenset({"abort", "hold"}))})


@pytest.fixture
def ann() -> Sender:
    return Sender(ANN)


def test_a_command_may_name_the_test_that_it_is_about(ann: Sender) -> None:
    gate = Gate("bench", "s1", {"ann": (ANN, frozenset({"skip"}))})
    assert gate.judge("skip", ann.sign("bench", "s1", "skip", "worn", "second")).test == "second"
    assert gate.judge("skip", ann.sign("bench", "s1", "skip")).test == ""


def why(gate: Gate, payload: bytes, name: str = "abort") -> str:
    with pytest.raises(Refused) as refused:
        gate.judge(name, payload)
    return refused.value.why


def body_of(payload: bytes) -> dict[str, object]:
    return dict(msgpack.unpackb(msgpack.unpackb(payload)["body"]))


def signed(payload: bytes, **changes: object) -> bytes:
    """Return a command changed by somebody who has the key."""
    return seal(ANN, msgpack.packb({**body_of(payload), **changes}))


def test_a_genuine_command_passes_with_its_sender_and_remark(gate: Gate, ann: Sender) -> None:
    command = gate.judge("abort", ann.sign("bench", "s1", "abort", "oil on\nthe floor"))
    assert (command.name, command.by, command.text) == ("abort", "ann", "oil on the floor")


def test_a_command_passes_once(gate: Gate, ann: Sender) -> None:
    payload = ann.sign("bench", "s1", "abort")
    gate.judge("abort", payload)
    assert why(gate, payload) == "replayed"


def test_a_command_does_not_pass_behind_a_later_one(gate: Gate, ann: Sender) -> None:
    first, second = (ann.sign("bench", "s1", "abort") for _ in range(2))
    gate.judge("abort", second)
    assert why(gate, first) == "replayed"


def test_a_changed_sequence_breaks_the_signature(gate: Gate, ann: Sender) -> None:
    envelope = msgpack.unpackb(ann.sign("bench", "s1", "abort"))
    body = msgpack.packb({**msgpack.unpackb(envelope["body"]), "sequence": 99})
    assert why(gate, msgpack.packb({**envelope, "body": body})) == "forged"


def test_a_signature_by_another_key_is_forged(gate: Gate) -> None:
    mallory = Sender(Credentials("ann", bytes(KEY_BYTES)))
    assert why(gate, mallory.sign("bench", "s1", "abort")) == "forged"


def test_a_sender_that_nobody_knows_is_unauthenticated(gate: Gate) -> None:
    # The key of one who is not known is not all zeros, though that is what it is compared with.
    bob = Sender(Credentials("bob", bytes(KEY_BYTES)))
    assert why(gate, bob.sign("bench", "s1", "abort")) == "unauthenticated"


@pytest.mark.parametrize("late_s", [WINDOW_S + 1.0, -WINDOW_S - 1.0])
def test_a_command_of_another_time_is_stale(
    gate: Gate, ann: Sender, clock: Clock, late_s: float
) -> None:
    payload = ann.sign("bench", "s1", "abort")
    clock.now_ns += round(1e9 * late_s)
    assert why(gate, payload) == "stale"


def test_a_command_to_an_earlier_session_is_a_replay(gate: Gate, ann: Sender) -> None:
    assert why(gate, ann.sign("bench", "s0", "abort")) == "replayed"


def test_a_command_to_another_rig_is_refused(gate: Gate, ann: Sender) -> None:
    assert why(gate, ann.sign("other", "s1", "abort")) == "misdirected"


def test_what_is_not_allowed_is_denied(gate: Gate, ann: Sender) -> None:
    assert why(gate, ann.sign("bench", "s1", "resume"), "resume") == "denied"


def test_a_command_on_the_key_of_another_is_refused(gate: Gate, ann: Sender) -> None:
    assert why(gate, ann.sign("bench", "s1", "hold"), "abort") == "malformed"


def test_without_operators_everything_is_denied(ann: Sender) -> None:
    gate = gate_of(StreamSettings(), "bench", "s1")
    assert why(gate, ann.sign("bench", "s1", "abort")) == "denied"


def test_an_oversized_payload_is_refused_unread(gate: Gate) -> None:
    assert why(gate, bytes(LARGEST_COMMAND + 1)) == "oversized"


@given(st.binary(max_size=200))
def test_bytes_that_are_no_command_are_refused(payload: bytes) -> None:
    gate = Gate("bench", "s1", {"ann": (ANN, frozenset({"abort"}))})
    assert why(gate, payload) == "malformed"


@pytest.mark.parametrize(
    "changes",
    [{"sequence": "1"}, {"sequence": True}, {"sender": 1}, {"more": 1}, {"at_ns": 1.0}],
    ids=str,
)
def test_a_signed_body_of_other_fields_is_malformed(
    gate: Gate, ann: Sender, changes: dict[str, object]
) -> None:
    assert why(gate, signed(ann.sign("bench", "s1", "abort"), **changes)) == "malformed"


def test_a_command_with_a_key_twice_is_refused_by_the_key_s_name(gate: Gate, ann: Sender) -> None:
    payload = ann.sign("bench", "s1", "hold")
    assert payload[0] == 0x84, "a map of four"
    twice = b"\x85" + payload[1:] + msgpack.packb("by") + msgpack.packb("ann")
    with pytest.raises(Refused, match="malformed: has the key 'by' twice"):
        gate.judge("hold", twice)


def test_a_nested_bomb_is_refused(gate: Gate) -> None:
    assert why(gate, b"\x91" * LARGEST_COMMAND) == "malformed"


def test_a_crowd_of_senders_does_not_push_out_what_is_remembered(gate: Gate, ann: Sender) -> None:
    payload = ann.sign("bench", "s1", "abort")
    gate.judge("abort", payload)
    for k in range(SENDERS_KEPT - 1):
        gate.judge("abort", signed(payload, sender=k.to_bytes(8, "big")))
    assert why(gate, signed(payload, sender=b"one more")) == "denied"
    assert why(gate, payload) == "replayed"


def test_a_key_that_others_can_read_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "key"
    make_key(path)
    assert len(read_key(path)) == KEY_BYTES
    path.chmod(0o640)
    with pytest.raises(KeyFileError, match="chmod 600"):
        read_key(path)


@pytest.mark.parametrize("content", ["", "00" * 31, "zz" * 32, "é" * 32])
def test_a_file_without_a_key_is_refused(tmp_path: Path, content: str) -> None:
    path = tmp_path / "key"
    path.write_text(content)
    path.chmod(0o600)
    with pytest.raises(KeyFileError, match="openssl rand"):
        read_key(path)


def test_a_key_that_is_there_is_not_made_anew(tmp_path: Path) -> None:
    path = tmp_path / "keys" / "ann.key"
    make_key(path)
    key = read_key(path)
    make_key(path)
    assert read_key(path) == key


def test_this_users_own_key_is_made_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    assert own_key("stream.key") == own_key("stream.key")
    (path,) = tmp_path.rglob("*.key")
    assert os.stat(path).st_mode & 0o777 == 0o600


def test_a_missing_key_is_reported_with_its_path(tmp_path: Path) -> None:
    operator = Operator("ann", ("abort",), tmp_path / "none.key")
    with pytest.raises(KeyFileError, match=r"none\.key"):
        gate_of(StreamSettings(operators=(operator,)), "bench", "s1")


def test_credentials_do_not_show_their_key() -> None:
    assert KEY.hex() not in repr(ANN)
    assert str(KEY) not in repr(ANN)
