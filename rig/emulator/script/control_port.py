"""A TCP port by which a test in any language controls the emulator: JSON, one object a line.

A request is an object whose key `do` names an action. The reply is an object with `ok`, and with
`problems` if that is false:

    {"do": "inject", "fault": "delay", "target": "daq", "by": "5 ms", "for": "500 ms"}
    {"do": "clear"}                      ends all faults; one: {"do": "clear", "number": 3}
    {"do": "status"}                     returns the states of all devices and of the plant
    {"do": "record", "since_ns": 0}      returns the events from that time on
    {"do": "operator", "attentive": false}
    {"do": "press_reset"}
    {"do": "stop"}
"""

import asyncio
import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from rig.configuration import ConfigError, suggestion
from rig.emulator.addresses import listen
from rig.surviving import failure
from rig.unique_keys import RepeatedKeyError, unique_keys

from .fault_script import fault_from
from .injection import NotServedError

if TYPE_CHECKING:
    from rig.emulator.application import Emulator

_LINE_LIMIT: Final = 65536

_KEYS: Final[Mapping[str, Mapping[str, type]]] = {
    "inject": {},
    "clear": {"number": int},
    "status": {},
    "record": {"since_ns": int},
    "operator": {"attentive": bool},
    "press_reset": {},
    "stop": {},
}
"""Keys of a request besides `do`, with their types; those of `inject` are those of a fault, which
are checked with it."""


class ControlPort:
    """Serves the requests of any number of clients.

    Args:
        emulator: the emulator that the clients control.

    Attributes:
        clients: the connections that are open now.
    """

    def __init__(self, emulator: "Emulator") -> None:
        self._emulator = emulator
        self._server: asyncio.Server | None = None
        self.clients: set[asyncio.Transport] = set()

    async def open(self, host: str, port: int) -> int:
        """Begin to serve; return the port, which the system chooses if 0 is asked for.

        Raises:
            AddressError: the port is in use, or cannot be used.
        """
        self._server, port = await listen("control", host, port, lambda: _Client(self))
        return port

    def close(self) -> None:
        """Close the port, and all connections once their replies are sent."""
        if self._server is not None:
            self._server.close()
        for client in tuple(self.clients):
            client.close()

    def answer(self, line: bytes) -> dict[str, Any]:
        """Carry out the request of one line and return the reply, which may be a refusal.

        No line raises an error: the reply reports it.
        """
        try:
            return self._answer(line)
        except Exception as error:  # the reply reports it, and the client may go on
            return _refusal(f"request: it failed: {failure(error)}")

    def _answer(self, line: bytes) -> dict[str, Any]:
        try:
            request = json.loads(line, object_pairs_hook=unique_keys)
        except RepeatedKeyError as error:
            return _refusal(f"request: {error}; write each once")
        except (ValueError, RecursionError) as error:
            return _refusal(f"request: is not JSON: {error}; write one object a line")
        keys = request if isinstance(request, dict) else {}
        do = str(keys.pop("do", ""))
        if do not in _KEYS:
            remedy = suggestion(do, tuple(_KEYS), "actions")
            return _refusal(f"do: {do} is not a known action; {remedy}")
        problems = [
            f"{key}: {value} is not a key of {do}, or of another type; {_keys(do)}"
            for key, value in keys.items()
            if do != "inject" and type(value) is not _KEYS[do].get(key)
        ]
        if problems:
            return _refusal(*problems)
        try:
            return {"ok": True, **self._done(do, keys)}
        except (ConfigError, NotServedError) as error:
            return _refusal(*map(str, error.problems))

    def _done(self, do: str, keys: Mapping[str, Any]) -> dict[str, Any]:
        """Carry out an action with the keys of its request; return the reply without `ok`."""
        emulator = self._emulator
        match do:
            case "inject":
                return {"number": emulator.injection.inject(fault_from(keys))}
            case "clear":
                return {"cleared": emulator.injection.clear(keys.get("number"))}
            case "status":
                return emulator.status()
            case "record":
                since = keys.get("since_ns", 0)
                return {"events": [e for e in emulator.record.events if e["at_ns"] >= since]}
            case "operator":
                emulator.operator.attentive = keys.get("attentive", True)
                return {"attentive": emulator.operator.attentive}
            case "press_reset":
                emulator.operator.press()
            case _:
                emulator.stop()
        return {}


def _keys(action: str) -> str:
    keys = ", ".join(f"{key} ({kind.__name__})" for key, kind in _KEYS[action].items())
    return f"keys: {keys}" if keys else "it takes none"


class _Client(asyncio.Protocol):
    """One connection, which takes lines off the stream and answers each."""

    def __init__(self, port: ControlPort) -> None:
        self._port = port
        self._received = b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        self._port.clients.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:
        self._port.clients.discard(self._transport)

    def data_received(self, data: bytes) -> None:
        *lines, self._received = (self._received + data).split(b"\n")
        for line in lines:
            self._transport.write(json.dumps(self._port.answer(line)).encode() + b"\n")
        if len(self._received) > _LINE_LIMIT:
            self._transport.abort()


def _refusal(*problems: str) -> dict[str, Any]:
    return {"ok": False, "problems": list(problems)}
