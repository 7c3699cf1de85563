import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from rig.emulator.running import EmulatorThread

Ask = Callable[..., dict[str, Any]]


@pytest.fixture
def ask(emulator: EmulatorThread) -> Iterator[Ask]:
    address = ("127.0.0.1", int(emulator.ports["control"]))
    with socket.create_connection(address, timeout=20.0) as line, line.makefile("rw") as text:

        def ask(**request: Any) -> dict[str, Any]:
            text.write(json.dumps(request) + "\n")
            text.flush()
            reply: dict[str, Any] = json.loads(text.readline())
            return reply

        yield ask


def test_a_fault_is_injected_and_cleared_by_its_number(ask: Ask) -> None:
    number = ask(do="inject", fault="delay", by="2 ms")["number"]
    (fault,) = ask(do="status")["faults"]
    assert (fault["fault"], fault["by"], fault["acting"]) == ("delay", 0.002, True)
    assert ask(do="clear", number=number) == {"ok": True, "cleared": 1}
    assert ask(do="status")["faults"] == []


def test_the_record_can_be_read_from_a_moment_on(ask: Ask) -> None:
    ask(do="inject", fault="estop")
    events = ask(do="record")["events"]
    assert [event["event"] for event in events][-2:] == ["fault_begins", "estop_opened"]
    later = ask(do="record", since_ns=events[-1]["at_ns"])["events"]
    assert [event["event"] for event in later] == ["estop_opened"]


def test_the_reset_button_is_pressed_when_asked_for(ask: Ask) -> None:
    assert ask(do="operator", attentive=False) == {"ok": True, "attentive": False}
    assert ask(do="press_reset") == {"ok": True}


@pytest.mark.parametrize(
    ("request_object", "told"),
    [
        ({"do": "injekt"}, "did you mean inject?"),
        ({}, "is not a known action"),
        ({"do": "inject", "fault": "sensor"}, "add `target: ...`"),
        ({"do": "inject", "fault": "meter_noise"}, "no flow meters"),
        ({"do": "clear", "number": "3"}, "keys: number (int)"),
        ({"do": "status", "of": "daq"}, "it takes none"),
    ],
)
def test_a_request_that_cannot_be_granted_is_answered_with_the_reason_and_hurts_nobody(
    ask: Ask, request_object: dict[str, Any], told: str
) -> None:
    reply = ask(**request_object)
    assert reply["ok"] is False
    assert told in " ".join(reply["problems"])
    assert ask(do="status")["ok"]


def test_what_is_not_json_is_answered_so(emulator: EmulatorThread) -> None:
    address = ("127.0.0.1", int(emulator.ports["control"]))
    with socket.create_connection(address, timeout=20.0) as line, line.makefile("rw") as text:
        text.write('status\n[1]\n{"do": "status", "do": "stop"}\n')
        text.flush()
        replies = [json.loads(text.readline()) for _ in range(3)]
    assert [reply["ok"] for reply in replies] == [False, False, False]
    assert "is not JSON" in replies[0]["problems"][0]
    assert "the key 'do' twice" in replies[2]["problems"][0]


NONSENSE = {
    "not UTF-8": b'{"do": "caf\xe9"}',
    "half a character": b'{"do": "\\udce9"}',
    "endless nesting": b"[" * 30_000,
    "a list for an action": b'{"do": ["status"]}',
    "a list for a fault": b'{"do": "inject", "fault": ["delay"], "by": [[[]]]}',
    "a number without end": b'{"do": "inject", "fault": "delay", "by": 1e999}',
    "a long number": b'{"do": "record", "since_ns": ' + b"9" * 5000 + b"}",
    "a key of the program": b'{"do": "inject", "self": 1}',
    "a map for a time": b'{"do": "inject", "fault": "estop", "at": {"a": {"b": 1}}}',
}


@pytest.mark.parametrize("kind", NONSENSE)
def test_nonsense_is_answered_and_the_next_request_granted(
    emulator: EmulatorThread, kind: str
) -> None:
    address = ("127.0.0.1", int(emulator.ports["control"]))
    with socket.create_connection(address, timeout=20.0) as line, line.makefile("rb") as text:
        line.sendall(NONSENSE[kind] + b"\n")
        refusal = json.loads(text.readline())
        assert not refusal["ok"]
        assert refusal["problems"]
        line.sendall(b'{"do": "status"}\n')
        assert json.loads(text.readline())["ok"]
