"""A TCP port through which a test, in whatever language, steers the emulator: JSON, line by line.

A request is an object with what to `do`; the reply is an object with `ok`, and `problems` if not:

    {"do": "inject", "fault": "delay", "target": "daq", "by": "5 ms", "for": "500 ms"}
    {"do": "clear"}                      or one fault: {"do": "clear", "number": 3}
    {"do": "status"}                     how all devices stand, and the plant's true state
    {"do": "record", "since_ns": 0}      events from then on
    {"do": "operator", "attentive": false}
    {"do": "press_reset"}
    {"do": "stop"}
"""

import asyncio
import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final, Protocol

from rig.configuration.problems import ConfigError, suggestion

from .addresses import AddressError
from .effects import NotServedError
from .injection import Injection
from .operator_panel import EmulatedOperator
from .record import Record
from .wire_faults import fault_from

_LINE_LIMIT: Final = 65536


class Steered(Protocol):
    """What the control port steers."""

    injection: Injection
    operator: EmulatedOperator
    record: Record

    def status(self) -> dict[str, Any]:
        """Return how everything stands."""

    def stop(self) -> None:
        """End the emulator."""


class ControlPort:
    """Serves requests of any number of clients.

    Args:
        emulator: what they steer.
    """

    def __init__(self, emulator: Steered) -> None:
        self._emulator = emulator
        self._server: asyncio.Server | None = None
        self._clients: set[asyncio.StreamWriter] = set()
        self._actions: dict[str, Callable[[Mapping[str, Any]], dict[str, Any]]] = {
            "inject": self._inject,
            "clear": self._clear,
            "status": self._status,
            "record": self._events,
            "operator": self._operator,
            "press_reset": self._press_reset,
            "stop": self._stop,
        }

    async def open(self, host: str, port: int) -> int:
        """Begin to serve; return the port, which the system chooses if 0 is asked for.

        Raises:
            AddressError: the port is in use, or not to be had.
        """
        try:
            self._server = await asyncio.start_server(self._serve, host, port, limit=_LINE_LIMIT)
        except OSError as error:
            raise AddressError("control", host, port, error) from error
        found: int = self._server.sockets[0].getsockname()[1]
        return found

    def close(self) -> None:
        """Let go of the port and of all clients."""
        if self._server is not None:
            self._server.close()
        for client in tuple(self._clients):
            client.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.add(writer)
        # A line beyond the limit ends the connection, as does the client's own end.
        with suppress(ValueError, ConnectionError):
            while line := await reader.readline():
                writer.write(json.dumps(self.answer(line)).encode() + b"\n")
                await writer.drain()
        self._clients.discard(writer)
        writer.close()

    def answer(self, line: bytes) -> dict[str, Any]:
        """Do what one line asks for and return the reply."""
        try:
            request = json.loads(line)
        except ValueError as error:
            return _refusal(f"request: is not JSON: {error}; write one object a line")
        if not isinstance(request, dict) or request.get("do") not in self._actions:
            asked = str(request.get("do", "")) if isinstance(request, dict) else ""
            remedy = suggestion(asked, tuple(self._actions), "actions")
            return _refusal(f"do: {asked} is not a known action; {remedy}")
        action = self._actions[request.pop("do")]
        try:
            return {"ok": True, **action(request)}
        except (ConfigError, NotServedError) as error:
            return _refusal(*map(str, error.problems))

    def _inject(self, request: Mapping[str, Any]) -> dict[str, Any]:
        return {"number": self._emulator.injection.inject(fault_from(request))}

    def _clear(self, request: Mapping[str, Any]) -> dict[str, Any]:
        return {"cleared": self._emulator.injection.clear(request.get("number"))}

    def _status(self, request: Mapping[str, Any]) -> dict[str, Any]:
        return self._emulator.status()

    def _events(self, request: Mapping[str, Any]) -> dict[str, Any]:
        since = request.get("since_ns", 0)
        events = self._emulator.record.events
        return {"events": [event for event in events if event["at_ns"] >= since]}

    def _operator(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._emulator.operator.attentive = bool(request.get("attentive", True))
        return {"attentive": self._emulator.operator.attentive}

    def _press_reset(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._emulator.operator.press()
        return {}

    def _stop(self, request: Mapping[str, Any]) -> dict[str, Any]:
        self._emulator.stop()
        return {}


def _refusal(*problems: str) -> dict[str, Any]:
    return {"ok": False, "problems": list(problems)}
