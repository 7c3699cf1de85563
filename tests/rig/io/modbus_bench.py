"""Helpers for tests of the Modbus driver: shipped maps, a scripted device, a pymodbus device."""

import socket
import struct
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pymodbus.client import ModbusTcpClient
from pymodbus.pdu import ModbusPDU
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from rig.configuration.reading.document import Sources
from rig.configuration.reading.lookup import shipped_config_dir
from rig.configuration.reading.options import read_options
from rig.io.driver import ExchangeStatus
from rig.io.modbus_daq.compiled_exchange import ExchangePlan
from rig.io.modbus_daq.plan import exchange_plans
from rig.io.modbus_daq.register_map import ExchangeMode, Register, RegisterMap
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from tests.rig.io.conftest import DeviceThread
from tests.waiting import until

UNIT = 9


def shipped_map(name: str) -> RegisterMap:
    """Return the register map of that name in `config/maps`."""
    sources = Sources()
    path = shipped_config_dir() / "maps" / f"{name}.yaml"
    found = read_options(RegisterMap, sources.read_yaml(path))
    assert found is not None, sources.problems
    return found


def map_of(*registers: Register, **changes: object) -> RegisterMap:
    """Return the map of the I/O node with other registers, and other fields changed."""
    given: Any = {"owner": None, "registers": registers, **changes}
    return replace(shipped_map("io_node"), **given)


def framed(transaction: int, pdu: bytes, unit: int = UNIT) -> bytes:
    """Return a Modbus/TCP frame with the protocol data unit `pdu`."""
    return struct.pack(">HHHB", transaction & 0xFFFF, 0, 1 + len(pdu), unit) + pdu


class Line:
    """A connection between the driver's plan and the test, which plays the device; it never waits.

    Attributes:
        plan: the driver's exchange plan.
        inputs: the inputs of the last exchange, in the order of `FAST_INPUTS`.
        device: the device's end of the connection.
    """

    def __init__(
        self, register_map: RegisterMap, mode: ExchangeMode = "fc23", unit: int = UNIT
    ) -> None:
        self.plan: ExchangePlan = exchange_plans(register_map, mode, unit)[0]
        self.inputs = np.zeros(len(FAST_INPUTS))
        self._host, self.device = socket.socketpair()
        self.device.setblocking(False)

    def __enter__(self) -> "Line":
        return self

    def __exit__(self, *_: object) -> None:
        self._host.close()
        self.device.close()

    def exchange(self, sequence: int, outputs: Mapping[str, float] | None = None) -> ExchangeStatus:
        """Make an exchange whose deadline is past; it uses only replies that are already there."""
        given = np.array([(outputs or {}).get(name, 0.0) for name in FAST_OUTPUTS])
        fd = self._host.fileno()
        status, _ = self.plan.exchange(fd, sequence, given, self.inputs, 0)
        return ExchangeStatus(status)

    def send(self, *frames: bytes) -> None:
        """Send frames from the device to the driver."""
        self.device.sendall(b"".join(frames))

    def received(self) -> bytes:
        """Return the bytes that the device received since the last call.

        Raises:
            BlockingIOError: there are none.
        """
        return self.device.recv(65536)

    def input(self, signal: str) -> float:
        """Return the value of a signal in the last exchange."""
        return float(self.inputs[FAST_INPUTS.index(signal)])


def registers_of(values: Iterable[int]) -> bytes:
    """Return the bytes by which registers with these values are sent."""
    return b"".join(value.to_bytes(2, "big") for value in values)


class PymodbusDevice:
    """A device with a thousand registers, served by pymodbus's own server.

    Attributes:
        port: its port on 127.0.0.1.
        asked: function codes of all requests so far.
        connections: number of connections that were made to it.
    """

    def __init__(self, thread: DeviceThread, registers: Mapping[int, int]) -> None:
        self.asked: list[int] = []
        self.connections = self._open = 0
        self._thread = thread
        self._server = thread.run(self._serve([registers.get(at, 0) for at in range(1000)]))
        self.port = int(self._server.transport.sockets[0].getsockname()[1])

    async def _serve(self, values: list[int]) -> Any:
        server = ModbusTcpServer(
            SimDevice(UNIT, [SimData(0, values=values, datatype=DataType.REGISTERS)]),
            address=("127.0.0.1", 0),
            trace_pdu=self._trace,
            trace_connect=self._connected,
        )
        await server.serve_forever(background=True)
        return server

    def _trace(self, sending: bool, pdu: ModbusPDU) -> ModbusPDU:
        if not sending:
            self.asked.append(pdu.function_code)
        return pdu

    def _connected(self, connected: bool) -> None:
        self.connections += connected
        self._open += 1 if connected else -1

    def read(self, address: int, count: int = 1) -> list[int]:
        """Return the values of registers, read by pymodbus's own client."""
        with ModbusTcpClient("127.0.0.1", port=self.port) as client:
            reply = client.read_holding_registers(address, count=count, device_id=UNIT)
        return list(reply.registers)

    def write(self, address: int, values: list[int]) -> None:
        """Write registers by pymodbus's own client."""
        with ModbusTcpClient("127.0.0.1", port=self.port) as client:
            assert not client.write_registers(address, values, device_id=UNIT).isError()

    def vanish(self) -> None:
        """Close the port and all connections."""
        self._thread.run(self._server.shutdown())
        self._server = None

    def end(self) -> None:
        """Close the port, after the connections of all clients were accepted and closed."""
        if self._server is not None:
            self.read(0)
            until(lambda: self._open == 0)
            self.vanish()
