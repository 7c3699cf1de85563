"""The bypass valves' I/O as a Modbus device, served by pymodbus over TCP or a serial line.

Its registers are those of `rig.io.bypass_valves.registers`; any unit number reaches it.
"""

import asyncio
import random
import time
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusSerialServer, ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import DataType, SimData, SimDevice

from rig.channels import BLOCKING, BYPASSES
from rig.emulator.addresses import AddressError
from rig.emulator.pseudo_terminal import PseudoTerminal
from rig.emulator.record import Record
from rig.io import IDENTITY, NEEDLE_FULL_SCALE, STANDARD_REGISTERS, THROTTLE

from .server import Wire
from .valve_bank import SWITCHES, ValveBank

_COILS: Final = (1, 5, 15)
_DISCRETE_INPUTS: Final = (2,)
_INPUT_REGISTERS: Final = (4,)
_NEITHER: Final = (False, False)
_BOTH: Final = (True, True)


class BypassIo:
    """The emulated I/O device of the bypass valves, with the valves behind its registers.

    Args:
        record: takes note of what happens.
        clock: returns the time in ns.
        ball_travel_s: time that a ball takes from shut to open, s.
        blocking_travel_s: time that a blocking valve takes from open to shut, s; None for a device
            without them, which has no registers for them either.

    Attributes:
        valves: the valves; their method `stick` jams those of a bypass.
        wire: faults of the line to the device; other code may change them at any time.
        shorted: bypasses whose ball has both switches on, as by a damaged cable.
        identity: number in the identity register.
        requests: number of requests that the device has served, without those that a fault of the
            wire lost or refused.
    """

    name: Final = "bypass"

    def __init__(
        self,
        record: Record,
        clock: Callable[[], int] = time.monotonic_ns,
        ball_travel_s: float = 0.5,
        blocking_travel_s: float | None = None,
    ) -> None:
        self.valves = ValveBank(record, clock, ball_travel_s, blocking_travel_s)
        self.wire = Wire()
        self.shorted: set[str] = set()
        self.identity = IDENTITY
        self.requests = 0
        self._record = record
        self._noise = random.Random(0)
        self._servers: list[ModbusTcpServer] = []
        self._lines: list[_RtuLine] = []

    async def open(self, host: str, port: int) -> int:
        """Begin to serve over TCP; return the port, which the system chooses if 0 is asked for.

        Raises:
            AddressError: the port is in use, or cannot be used.
        """
        server = ModbusTcpServer(
            self._device(),
            address=(host, port),
            trace_packet=self._through_wire,
            trace_connect=self._note_connection,
        )
        try:
            # pymodbus's `listen` does the same, but swallows the reason for a failure.
            server.is_listener = True
            listener = server.transport = await server.call_create()
        except OSError as error:
            raise AddressError(self.name, host, port, error) from error
        self._servers.append(server)
        found: int = listener.sockets[0].getsockname()[1]
        return found

    async def open_serial(self, path: Path) -> None:
        """Begin to serve in Modbus RTU on a serial line whose near end is `path`.

        Raises:
            LinkError: the line cannot be made at the path.
        """
        line = PseudoTerminal(path)
        line.plug_in()
        server = ModbusSerialServer(self._device(), port=str(path), trace_packet=self._through_wire)
        self._lines.append(_RtuLine(line, server.callback_new_connection()))

    def close(self) -> None:
        """Close ports, lines and connections; repeated calls do no harm."""
        for server in self._servers:
            server.close()
        for line in self._lines:
            line.close()
        self._servers, self._lines = [], []

    def disconnect(self) -> None:
        """Close all TCP connections; clients may connect again."""
        for server in self._servers:
            for connection in tuple(server.active_connections.values()):
                # Pymodbus lists a connection before it is made. One that is closed before would
                # leave the list, and then be made and stay.
                if connection.is_active():
                    connection.close()

    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
        return {
            "requests": self.requests,
            "watchdog_ms": self.valves.watchdog_ms,
            "positions": self.valves.positions(),
            **({"blocking": shut} if (shut := self.valves.blocking()) else {}),
        }

    def _device(self) -> SimDevice:
        at = STANDARD_REGISTERS
        bits = partial(SimData, datatype=DataType.BITS)
        words = partial(SimData, datatype=DataType.REGISTERS)
        coils, switches = len(BYPASSES), 2 * len(BYPASSES)
        if self.valves.blocking():
            coils = at.blocking_coils + len(BLOCKING)
            switches = at.blocking_switches + 2 * len(BLOCKING)
        return SimDevice(
            id=0,  # whichever is asked for
            simdata=(
                [bits(at.coils, values=[False] * coils)],
                [bits(at.switches, values=[False] * switches)],
                [
                    words(at.setpoints, count=len(BYPASSES)),
                    words(at.identity, readonly=True),
                    words(at.watchdog),
                ],
                [words(at.positions, count=len(BYPASSES))],
            ),
            action=self._serve,
        )

    async def _serve(
        self,
        function: int,
        start: int,
        address: int,
        count: int,
        registers: list[int],
        values: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        """Act on the values of a request, or update the `registers` that it reads, in place.

        Pymodbus does the rest. Before that, faults of the wire may delay or refuse the request.
        Return the exception by which the request is refused; None if it is not.
        """
        if self.wire.delay_s > 0.0:
            await asyncio.sleep(self.wire.delay_s)
        if self.wire.requests_lost:
            return ExcCodes.DEVICE_BUSY  # `_through_wire` drops this reply as well
        if self.wire.exception:
            return ExcCodes(self.wire.exception)
        self.requests += 1
        self.valves.hear()
        if values is not None:
            return self._take(function, address, values)
        for place, value in self._current(function).items():
            registers[place - start] = value
        return None

    def _take(self, function: int, address: int, values: list[int] | list[bool]) -> ExcCodes | None:
        at = STANDARD_REGISTERS
        if function in _COILS and address >= at.blocking_coils:
            for valve, shut in zip(BLOCKING[address - at.blocking_coils :], values, strict=False):
                self.valves.order_blocking(valve, bool(shut))
        elif function in _COILS:
            first = address - at.coils
            if first + len(values) > len(BYPASSES):
                return ExcCodes.ILLEGAL_ADDRESS
            for bypass, opened in zip(BYPASSES[first:], values, strict=False):
                if bypass != THROTTLE:
                    self.valves.order_ball(bypass, bool(opened))
        elif address == at.watchdog:
            self.valves.watch(values[0])
        elif max(values) > NEEDLE_FULL_SCALE:
            return ExcCodes.ILLEGAL_VALUE
        else:
            for bypass, setpoint in zip(BYPASSES[address - at.setpoints :], values, strict=False):
                self.valves.order_needle(bypass, setpoint / NEEDLE_FULL_SCALE)
        return None

    def _current(self, function: int) -> Mapping[int, int]:
        """Return the present contents of the registers that a function reads, by address.

        Coils and switches are packed into registers of 16 bits.
        """
        at, valves = STANDARD_REGISTERS, self.valves
        if function in _COILS:
            found = {at.coils // 16: _packed(opened for opened, _ in valves.orders().values())}
            if shut := valves.blocking_orders():
                found[at.blocking_coils // 16] = _packed(shut.values())
            return found
        if function in _DISCRETE_INPUTS:
            pairs = (
                _BOTH if bypass in self.shorted else SWITCHES.get(ball, _NEITHER)
                for bypass, (ball, _) in valves.positions().items()
            )
            found = {at.switches // 16: _packed(switch for pair in pairs for switch in pair)}
            if blocking := valves.blocking():
                pairs = (SWITCHES.get(1.0 - shut, _NEITHER) for shut in blocking.values())
                found[at.blocking_switches // 16] = _packed(s for pair in pairs for s in pair)
            return found
        if function in _INPUT_REGISTERS:
            return _registers(at.positions, (needle for _, needle in valves.positions().values()))
        setpoints = _registers(at.setpoints, (needle for _, needle in valves.orders().values()))
        return {**setpoints, at.identity: self.identity, at.watchdog: valves.watchdog_ms}

    def _through_wire(self, sending: bool, data: bytes) -> bytes:
        """Return what the wire's present faults leave of a reply; requests pass unchanged.

        `sending` is true for replies, which this device sends.
        """
        return self.wire.passed(data, self._noise) if sending else data

    def _note_connection(self, connected: bool) -> None:
        self._record.note("connected" if connected else "disconnected", device=self.name)
        if connected and self.wire.refuses:
            asyncio.get_running_loop().call_soon(self.disconnect)


def _packed(bits: Iterable[bool]) -> int:
    return sum(bit << place for place, bit in enumerate(bits))


def _registers(first: int, shares: Iterable[float]) -> dict[int, int]:
    return {first + i: round(share * NEEDLE_FULL_SCALE) for i, share in enumerate(shares)}


class _RtuLine(asyncio.Transport):
    """The far end of a pseudo-terminal, which pymodbus uses as a serial port.

    Pymodbus itself opens serial ports only by name.

    Args:
        line: the pseudo-terminal, which must be plugged in.
        handler: answers the requests that come over it.
    """

    def __init__(self, line: PseudoTerminal, handler: ServerRequestHandler) -> None:
        super().__init__()
        self._line = line
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(line.fileno(), lambda: handler.data_received(line.read()))
        handler.connection_made(self)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send a reply."""
        self._line.write(bytes(data))

    def close(self) -> None:
        """Unplug the line."""
        self._loop.remove_reader(self._line.fileno())
        self._line.unplug()
