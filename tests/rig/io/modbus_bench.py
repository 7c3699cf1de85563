"""What the tests of the Modbus driver share: shipped maps, and a line that ends in the test."""

import socket
import struct
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from rig.configuration.document import Sources
from rig.configuration.lookup import shipped_config_dir
from rig.configuration.options import read_options
from rig.io.modbus_exchange import ExchangePlan, ExchangeStatus, exchange, exchange_plan
from rig.io.register_map import ExchangeMode, Register, RegisterMap
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS

UNIT = 9


def shipped_map(name: str) -> RegisterMap:
    """Return one of the maps in `config/maps`."""
    sources = Sources()
    path = shipped_config_dir() / "maps" / f"{name}.yaml"
    found = read_options(RegisterMap, sources.read_yaml(path), sources)
    assert found is not None, sources.problems
    return found


def map_of(*registers: Register, **changes: object) -> RegisterMap:
    """Return the I/O node's map with other registers."""
    return replace(shipped_map("io_node"), registers=registers, **changes)  # type: ignore[arg-type]


def framed(transaction: int, pdu: bytes, unit: int = UNIT) -> bytes:
    """Return a protocol data unit in its Modbus/TCP frame."""
    return struct.pack(">HHHB", transaction & 0xFFFF, 0, 1 + len(pdu), unit) + pdu


class Line:
    """A connection on which the test speaks for the device; nothing ever waits on it."""

    def __init__(self, register_map: RegisterMap, mode: ExchangeMode = "fc23") -> None:
        self.plan: ExchangePlan = exchange_plan(register_map, mode, UNIT)
        self.inputs = np.zeros(len(FAST_INPUTS))
        self._host, self.device = socket.socketpair()
        self.device.setblocking(False)

    def __enter__(self) -> "Line":
        return self

    def __exit__(self, *_: object) -> None:
        self._host.close()
        self.device.close()

    def exchange(self, sequence: int, outputs: Mapping[str, float] | None = None) -> ExchangeStatus:
        """Exchange with a deadline long past: what counts is what has come by now."""
        given = np.array([(outputs or {}).get(name, 0.0) for name in FAST_OUTPUTS])
        fd = self._host.fileno()
        return ExchangeStatus(exchange(fd, self.plan, sequence, given, self.inputs, 0))

    def send(self, *frames: bytes) -> None:
        """Send from the device."""
        self.device.sendall(b"".join(frames))

    def received(self) -> bytes:
        """Return what the device got since the last call."""
        return self.device.recv(65536)

    def input(self, signal: str) -> float:
        """Return what the last exchange read of a signal."""
        return float(self.inputs[FAST_INPUTS.index(signal)])


def registers_of(values: Iterable[int]) -> bytes:
    """Return registers as they are sent."""
    return b"".join(value.to_bytes(2, "big") for value in values)
