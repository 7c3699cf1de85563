"""Where the emulated devices are served: where the rig file has its drivers look for them."""

import asyncio
import errno
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple

from rig.configuration import Rig, suggestion
from rig.io import DriverSpec, RegisterMap

HOST: Final = "127.0.0.1"


class AddressError(ValueError):
    """An address that cannot be served on; bad input, as `problems` says to the command line."""

    def __init__(self, device: str, host: str, port: int, error: OSError) -> None:
        if error.errno == errno.EADDRINUSE:
            state = "in use"
            remedy = f"end the program that has it (`ss -ltnp` names it), or serve {device} on"
            remedy = f"{remedy} another port (0: any free one)"
        else:
            state = f"not to be had ({error.strerror or error})"
            remedy = "give an address of this machine, and a port from 1024 on"
        super().__init__(f"{device}: port {port} of {host} is {state}; {remedy}")
        self.problems = (str(self),)


class PortNameError(ValueError):
    """Ports given for drivers that the rig does not have; bad input, as `problems` says."""

    def __init__(self, unknown: Mapping[str, int], known: tuple[str, ...]) -> None:
        self.problems = tuple(
            f"{name}={port}: the rig has no such device; {suggestion(name, known, 'devices')}"
            for name, port in unknown.items()
        )
        super().__init__("\n".join(self.problems))


async def listen(
    device: str, host: str, port: int, client: Callable[[], asyncio.BaseProtocol]
) -> tuple[asyncio.Server, int]:
    """Begin to serve a device over TCP.

    Args:
        device: what messages call it.
        host: address to listen on.
        port: 0 lets the system choose one.
        client: makes what answers one connection.

    Returns:
        The server, and the port that it has.

    Raises:
        AddressError: the port is in use, or not to be had.
    """
    loop = asyncio.get_running_loop()
    try:
        server = await loop.create_server(client, host, port)
    except OSError as error:
        raise AddressError(device, host, port, error) from error
    return server, server.sockets[0].getsockname()[1]


class Address(NamedTuple):
    """A TCP address; port 0 lets the system choose."""

    host: str
    port: int


@dataclass(frozen=True)
class Endpoints:
    """Where each part of the emulated rig is served; None: not at all.

    Attributes:
        daq: the I/O device, Modbus/TCP.
        map: its registers; None: those of the generic I/O node.
        bypass: the bypass valves' I/O: Modbus/TCP, or a serial line in Modbus RTU.
        drive: the digital servovalve's `CanValveOptions`.
        pump: the pump unit's `CanPumpOptions`.
        meters: the flow meters' serial line.
        control: the control port.
    """

    daq: Address
    map: RegisterMap | None = None
    bypass: Address | Path | None = None
    drive: Any = None
    pump: Any = None
    meters: Path | None = None
    control: Address | None = None


_SIMULATED: Final = (
    ("daq", "modbus_daq", Address(HOST, 15502)),
    ("bypass", "bypass_valves", Address(HOST, 15503)),
)
"""Devices of a simulated rig, which has no drivers: served where those of `emulated` are."""


def endpoints_of(
    rig: Rig, ports: Mapping[str, int] | None = None, control: int | None = None
) -> Endpoints:
    """Return where the drivers of a rig look for their devices.

    A driver of a third party finds no device here.

    Args:
        rig: the rig.
        ports: other ports than the rig file's, by the driver's name in it.
        control: port of the control port; None for none.

    Raises:
        PortNameError: a port is given for a driver that is not served on one.
    """
    places = [(spec.name, spec.type, _place(spec)) for spec in rig.drivers] or list(_SIMULATED)
    by_port = {name: place for name, _, place in places if isinstance(place, Address)}
    given = dict(ports or {})
    if not given.keys() <= by_port.keys():
        unknown = {name: port for name, port in given.items() if name not in by_port}
        raise PortNameError(unknown, tuple(by_port))
    served: dict[str, Any] = {
        _PARTS[kind]: by_port[name]._replace(port=given[name]) if name in given else place
        for name, kind, place in places
        if kind in _PARTS
    }
    maps = [spec.options.map for spec in rig.drivers if spec.type == "modbus_daq"]
    served["map"] = maps[0] if maps else None
    return Endpoints(**served, control=None if control is None else Address(HOST, control))


_PARTS: Final = {
    "modbus_daq": "daq",
    "bypass_valves": "bypass",
    "can_valve": "drive",
    "can_pump": "pump",
    "flow_meters": "meters",
}
"""Fields of `Endpoints` by the type of driver that looks there."""


def _place(spec: DriverSpec) -> Any:
    """Return where a driver looks for its device: TCP address, serial port, or options of a bus."""
    options = spec.options
    if spec.type == "flow_meters":
        return Path(options.port)
    if spec.type in ("can_valve", "can_pump"):
        return options
    if spec.type == "bypass_valves" and options.transport == "rtu":
        return Path(options.device)
    return Address(options.host, options.port) if spec.type in _PARTS else None
