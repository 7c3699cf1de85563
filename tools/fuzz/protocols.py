"""Readers of what comes by sockets and buses: control port, stream, devices, web console."""

import asyncio
import itertools
import json
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from rig.configuration import load_rig
from rig.console.address import Address
from rig.console.launcher import Served
from rig.console.server import Console
from rig.io import FAST_INPUTS, FAST_OUTPUTS
from rig.io.can.ds408_valve import CanValveOptions, Ds408Valve
from rig.io.can.libraries import python_can as can
from rig.io.can.multicast import _frame
from rig.io.can.pump import CanPump, CanPumpOptions
from rig.io.flow_meters.lines import MeterLineParser, meter_line
from rig.io.modbus_daq.plan import exchange_plans
from rig.runner.campaign.control_port import ControlPort
from rig.runner.campaign.operator_requests import Desk
from rig.stream.client import StreamClient
from rig.stream.commands import Credentials, Gate, Refused, Sender, seal
from rig.stream.messages import MessageError, key, pack, read, unpack
from rig.stream.view import RigView
from rig.stream.voice import Voice

from .target import Target, scratch

ROOT: Final = Path(__file__).parents[2]
_RIG: Final = "bench"
_SESSION: Final = "s1"
_VOICE: Final = Voice(bytes(32))
_CREDENTIALS: Final = Credentials("operator", bytes(32))
_NODE: Final = 5


def _control(data: bytes) -> None:
    """Answer a request as the control port of a run does, in this thread."""
    port = ControlPort(scratch(), Desk(), lambda why: None)
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(data)
        theirs.shutdown(socket.SHUT_WR)
        ours.settimeout(1.0)
        answer = port._answer(ours)
        assert answer["ok"] or answer["problem"]
        assert not str(answer.get("problem", "")).startswith("it failed"), answer
        json.dumps(answer)


def _message(data: bytes) -> None:
    """Take a message of the stream, of the kind that its first byte says, as a reader does."""
    kinds = ("samples", "channels", "decision", "health", "campaign", "progress", "state", "event",
             "heartbeat")  # fmt: skip
    kind = kinds[data[0] % len(kinds)] if data else kinds[0]
    view = RigView(_RIG)
    # The same bytes unsigned, and as a rig would have signed them.
    for payload in (data[1:], _signed(kind, data[1:])):
        with suppress(MessageError):
            proven = _VOICE.said(key(_RIG, kind), payload)
            content = unpack(payload)
            view.admit(content, 1, is_proven=proven)
            read(kind, content)
            view.take(kind, content, 1)
            view.take_past(kind, content, 2)
    view.snapshot(10**9)
    view.window(1.0)


def _signed(kind: str, data: bytes) -> bytes:
    content: dict[str, Any] = {}
    with suppress(MessageError):
        content = unpack(data)
    content.pop("mac", None)
    with suppress(Exception):  # what cannot be packed can be sent by nobody
        return _VOICE.signed(key(_RIG, kind), content)
    return b""


def _header(**content: Any) -> dict[str, Any]:
    return {"version": 1, "session": _SESSION, "sequence": 1, "sent_ns": 1, **content}


def _messages() -> list[bytes]:
    one = np.zeros(1, "<f8").tobytes()
    contents: tuple[dict[str, Any], ...] = (
        {"channels_id": 0, "first_row": 0, "rows": 1, "test": 1, "newest_ns": 1,
         "time_s": one, "values": np.zeros(1, "<f4").tobytes()},
        {"id": 0, "names": ["position_m"], "units": ["m"]},
        {"verdict": "healthy", "probabilities": {"healthy": 1.0}, "statistic": 0.5, "test": 1},
        {"rate_hz": 1e3, "rows": 5, "timing": {}, "silent_s": {"loop": 0.1}, "action": "none"},
        {"status": "running", "name": "c", "tests": []},
        {"number": 1, "count": 2, "name": "one", "time_s": 1.0, "duration_s": 2.0},
        {"state": "armed", "since_ns": 1},
        {"at_ns": 1, "time_s": 0.5, "who": "loop", "kind": "trip", "text": "t"},
        {"heartbeat_s": 0.5, "up_s": 1.0, "rows": 1, "sequences": {"samples": 1}},
    )  # fmt: skip
    return [bytes([n]) + pack(_header(**each)) for n, each in enumerate(contents)]


def _command(data: bytes) -> None:
    """Judge a command as it is, and the same bytes in an envelope with a genuine signature."""
    gate = Gate(_RIG, _SESSION, {"operator": (_CREDENTIALS, frozenset({"abort", "note"}))})
    for payload in (data, seal(_CREDENTIALS, data)):
        with suppress(Refused):
            gate.judge("abort", payload)


def _commands() -> list[bytes]:
    sealed = Sender(_CREDENTIALS).sign(_RIG, _SESSION, "abort", "why")
    body = {"rig": _RIG, "session": _SESSION, "command": "abort", "sender": bytes(8),
            "sequence": 1, "at_ns": time.time_ns(), "text": ""}  # fmt: skip
    return [sealed, pack(body)]


_MODES: Final[tuple[Literal["fc23", "fc16_fc3"], ...]] = ("fc23", "fc16_fc3")


@cache
def _plans() -> list[Any]:
    rig = load_rig(str(ROOT / "config/rigs/emulated.yaml"))
    (fast,) = (spec for spec in rig.drivers if spec.kind == "fast")
    given: Any = fast.options
    return [exchange_plans(given.map, mode, given.unit)[0] for mode in _MODES]


def _modbus(data: bytes) -> None:
    """Exchange with an I/O node that replies with these bytes, in both ways of exchange."""
    inputs, outputs = np.zeros(len(FAST_INPUTS)), np.zeros(len(FAST_OUTPUTS))
    for plan in _plans():
        ours, theirs = socket.socketpair()
        with ours, theirs:
            theirs.sendall(data)
            # The deadline is past, so that only what is there already is used.
            plan.exchange(ours.fileno(), 1, outputs, inputs, 0)


def _replies() -> list[bytes]:
    pdu = bytes((23, 40)) + bytes(40)
    head = (1).to_bytes(2, "big") + bytes(2) + (len(pdu) + 1).to_bytes(2, "big") + b"\x01"
    return [head + pdu, head[:4] + b"\x00\x03\x01\x97\x02"]


def _can(data: bytes) -> None:
    """Take frames off a bus, as valve drive and pump unit; each begins with node, kind, length."""
    with suppress(Exception):  # a datagram that is no frame is refused by many types of errors
        _frame(data, 0.0)
    channel = f"fuzz{next(_numbers)}"
    drive = CanValveOptions(interface="virtual", channel=channel, node=_NODE, full_stroke=2.5e-4)
    valve = Ds408Valve("drive", drive, lambda: 0.0)
    dbc = ROOT / "config/dbc/pump_unit.dbc"
    pump = CanPump("pump", CanPumpOptions(interface="virtual", channel=channel, dbc=dbc))
    try:
        at = 0
        while at + 3 <= len(data):
            identifier = int.from_bytes(data[at : at + 2], "big") & 0x7FF
            size = data[at + 2] % 9
            frame = can.Message(
                arbitration_id=identifier, is_extended_id=False, data=data[at + 3 : at + 3 + size]
            )
            valve._take(frame)
            pump._take(bytes(frame.data))
            at += 3 + size
    finally:
        valve.close()


_numbers: Final = itertools.count()


def _frames() -> list[bytes]:
    status = bytes((0x01, 0x85, 8)) + bytes(8)
    heartbeat = bytes((0x07, 0x05, 1, 5))
    return [status + heartbeat, bytes((0x00, 0x85, 8)) + bytes(range(8))]


def _meters(data: bytes) -> None:
    parser = MeterLineParser()
    half = len(data) // 2
    for piece in (data[:half], data[half:]):
        parser.feed(piece)


class _Client(StreamClient):
    """A client of the stream that has heard of no rig."""

    def __init__(self) -> None:
        """Open nothing."""

    def rigs(self) -> tuple[str, ...]:
        """Return that there is no rig."""
        return ()


@cache
def _console() -> tuple[Console, str]:
    """Return a console with a visitor, and the cookie of that visitor."""
    address = Address("127.0.0.1", 8000, frozenset({"127.0.0.1:8000"}))
    served = Served(folder=scratch() / "runs")
    console = Console(_Client(), "token", address, served, lambda line: None)
    return console, console.visitors.log_in("token", "operator", "127.0.0.1")


def _http(data: bytes) -> None:
    """Send the console a request: a line with method and path, lines of headers, and a body."""
    head, _, body = data.partition(b"\r\n\r\n")
    first, *lines = head.split(b"\r\n")
    method, _, rest = first.partition(b" ")
    path, _, query = rest.partition(b" ")[0].partition(b"?")
    console, cookie = _console()
    named = (line.partition(b":") for line in lines)
    headers = [(name.strip().lower(), value.strip()) for name, _, value in named if name.strip()]
    headers += [
        (b"host", b"127.0.0.1:8000"), (b"origin", b"http://127.0.0.1:8000"),
        (b"cookie", f"{console.cookie}={cookie}".encode()),
    ]  # fmt: skip
    scope = {
        "type": "http", "http_version": "1.1", "method": method.decode("latin-1").upper(),
        "scheme": "http", "path": path.decode("utf-8", "replace"), "raw_path": path,
        "query_string": query, "headers": headers, "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8000), "root_path": "",
    }  # fmt: skip
    asyncio.run(_served(console, scope, body))


async def _served(console: Console, scope: dict[str, Any], body: bytes) -> None:
    statuses: list[int] = []
    asked = [{"type": "http.request", "body": body, "more_body": False}]

    async def receive() -> Any:
        return asked.pop() if asked else {"type": "http.disconnect"}

    async def send(message: Any) -> None:
        if message["type"] == "http.response.start":
            statuses.append(int(message["status"]))

    await console.application()(scope, receive, send)
    assert statuses, "no answer"
    assert statuses[0] < 500, f"status {statuses[0]}"


def _requests() -> list[bytes]:
    json_head = b"POST /order HTTP/1.1\r\ncontent-type: application/json\r\n\r\n"
    return [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET /page/console.js HTTP/1.1\r\n\r\n",
        b"POST /login HTTP/1.1\r\n\r\ntoken=token&name=me",
        json_head + b'{"order": "abort", "rig": "bench"}',
        json_head + b'{"order": "start", "name": "quickstart"}',
    ]


def _of(*seeds: bytes) -> Callable[[], Sequence[bytes]]:
    def give() -> Sequence[bytes]:
        return seeds

    return give


PROTOCOLS: Final = (
    Target("control", _control,
           _of(b'{"request": "status"}\n', b'{"request": "note", "text": "a"}\n',
               b'{"request": "set", "text": "gain=80V/m"}\n'),
           4096),
    Target("message", _message, _messages, 4096),
    Target("command", _command, _commands, 2048),
    Target("modbus", _modbus, _replies, 512),
    Target("can", _can, _frames, 512),
    Target("meters", _meters, _of(meter_line(1, 1e-5), meter_line(2, 0.0, True)), 1024),
    Target("http", _http, _requests, 4096),
)  # fmt: skip
"""Targets that read what comes by sockets and buses."""
