"""The addresses of the emulated devices, which are those that the drivers of a rig file use."""

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
    """Raised for an address that cannot be used; the command line shows `problems`."""

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
    """Raised for ports of drivers that the rig lacks; the command line shows `problems`."""

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
        device: name of the device in messages.
        host: address to listen on.
        port: port to listen on; 0 lets the system choose one.
        client: makes the protocol object that answers one connection.

    Returns:
        The server, and the port on which it listens.

    Raises:
        AddressError: the port is in use, or cannot be used.
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
    """The address of each part of the emulated rig; a part whose address is None is not served.

    Attributes:
        daq: address of the I/O device, Modbus/TCP.
        map: registers of the I/O device; None for those of the generic I/O node.
        bypass: address of the bypass valves' I/O: Modbus/TCP, or a serial line in Modbus RTU.
        drive: `CanValveOptions` of the digital servovalve.
        pump: `CanPumpOptions` of the pump unit.
        meters: serial line of the flow meters.
        control: address of the control port.
    """

    daq: Address
    map: RegisterMap | None = None
    bypass: Address | Path | None = None
    drive: Any = None
    pump: Any = None
    meters: Path | None = None
    control: Address | None = None


_SIMULATED: Final = {
    "daq": ("modbus_daq", Address(HOST, 15502)),
    "bypass": ("bypass_valves", Address(HOST, 15503)),
}
"""Devices that are served for a simulated rig, which has no drivers; as in the rig `emulated`."""


def endpoints_of(
    rig: Rig, ports: Mapping[str, int] | None = None, control: int | None = None
) -> Endpoints:
    """Return the addresses at which the drivers of a rig look for their devices.

    No device is served for a driver of a third party. For a rig without drivers, an I/O device and
    bypass valves are served, as in the rig `emulated`.

    Args:
        rig: the rig.
        ports: TCP ports that replace those of the rig file, by the driver's name in it.
        control: TCP port of the control port; None for none.

    Raises:
        PortNameError: a port is given for a name that is not that of a driver with a TCP port.
    """
    places = {spec.name: (spec.type, _place(spec)) for spec in rig.drivers} or _SIMULATED
    by_port = {name: place for name, (_, place) in places.items() if isinstance(place, Address)}
    given = dict(ports or {})
    unknown = {name: port for name, port in given.items() if name not in by_port}
    if unknown:
        raise PortNameError(unknown, tuple(by_port))
    served: dict[str, Any] = {
        _PARTS[kind]: by_port[name]._replace(port=given[name]) if name in given else place
        for name, (kind, place) in places.items()
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
"""Fields of `Endpoints`, by the type of the driver that uses the device."""


def _place(spec: DriverSpec) -> Any:
    """Return where a driver looks for its device: TCP address, serial port, or CAN options.

    Return None for a driver whose device the emulator does not have.
    """
    options = spec.options
    if spec.type == "flow_meters":
        return Path(options.port)
    if spec.type in ("can_valve", "can_pump"):
        return options
    if spec.type == "bypass_valves" and options.transport == "rtu":
        return Path(options.device)
    return Address(options.host, options.port) if spec.type in _PARTS else None
