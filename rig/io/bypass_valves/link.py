"""A connection to the I/O device of the bypass valves, through pymodbus."""

import logging
from collections.abc import Callable, Mapping, Sequence
from math import nan
from typing import Any, Final

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from rig.channels import BLOCKING, BYPASSES
from rig.io.driver import DriverError

from .registers import IDENTITY, NEEDLE_FULL_SCALE, THROTTLE, BypassRegisters

Client = ModbusTcpClient | ModbusSerialClient

# Errors of pymodbus are raised as DriverError, so that they need not be printed as well.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_BY_SWITCHES: Final = {
    (True, False): 1.0,
    (False, False): 0.5,
    (False, True): 0.0,
    (True, True): nan,
}


class BypassLink:
    """One connection for valve positions and commands; the device's identity is verified.

    Args:
        driver: name of the driver, for error messages.
        client: pymodbus client, not yet connected, with retries off.
        registers: addresses in the device.
        unit: Modbus unit identifier.

    Raises:
        DriverError: no device answers there, or another one does.
    """

    def __init__(self, driver: str, client: Client, registers: BypassRegisters, unit: int) -> None:
        self._driver = driver
        self._client = client
        self._registers = registers
        self._unit = unit
        if not client.connect():
            state = f"cannot connect to {self._place}"
            raise self._error("", state, "check power, cable, address, other users")
        try:
            address = registers.identity
            (identity,) = self._read("identity", client.read_holding_registers, address, 1)
            if identity != IDENTITY:
                state = f"{self._place} is 0x{identity:04x} and not 0x{IDENTITY:04x}"
                action = "check the address: another device answers"
                raise self._error("identity", state, action)
        except DriverError:
            self.close()
            raise

    def close(self) -> None:
        """Close the connection; repeated calls do no harm."""
        self._client.close()

    @property
    def lost(self) -> bool:
        """Whether the connection is closed, by this program or the device; requests fail then."""
        return not self._client.connected

    def set_watchdog(self, time_s: float) -> None:
        """Set the time in s without a request after which the device's watchdog acts; 0: never.

        The device then shuts the balls and opens the throttle by itself.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        milliseconds = round(time_s * 1e3)
        self._ask("watchdog", self._client.write_register, self._registers.watchdog, milliseconds)

    def move(self, signal: str, target: float) -> None:
        """Command a valve to a position without waiting for its move.

        Args:
            signal: `<bypass>_ball`, `<bypass>_needle`, or one of `BLOCKING`.
            target: 0 or 1 (open) for a ball, an opening from 0 to 1 for a needle, 0 or 1 (shut) for
                a blocking valve.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        if signal in BLOCKING:
            coil = self._registers.blocking_coils + BLOCKING.index(signal)
            self._ask(signal, self._client.write_coil, coil, target == 1.0)
            return
        bypass, _, kind = signal.rpartition("_")
        i = BYPASSES.index(bypass)
        if kind == "ball":
            self._ask(signal, self._client.write_coil, self._registers.coils + i, target == 1.0)
        else:
            register, number = self._registers.setpoints + i, round(target * NEEDLE_FULL_SCALE)
            self._ask(signal, self._client.write_register, register, number)

    def shut_balls(self, bypasses: Sequence[str]) -> None:
        """Command balls to shut by one request, without waiting for their moves.

        They are those of all bypasses from the first of `BYPASSES` to the last of `bypasses`.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        shut = [False] * (1 + max(BYPASSES.index(bypass) for bypass in bypasses))
        self._ask("balls", self._client.write_coils, self._registers.coils, shut)

    def open_blocking(self) -> None:
        """Command both blocking valves to open, without waiting for their moves.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        at, opened = self._registers.blocking_coils, [False] * len(BLOCKING)
        self._ask("blocking valves", self._client.write_coils, at, opened)

    def check_blocking(self) -> None:
        """Check that the device has the registers of blocking valves; none of them moves.

        Raises:
            DriverError: it has not, or does not reply.
        """
        try:
            self.blocking()
            at, count = self._registers.blocking_coils, len(BLOCKING)
            self._read("coils", self._client.read_coils, at, count)
        except DriverError as error:
            if self.lost:
                raise
            state = f"{self._place} does not serve blocking valves: {error.state}"
            action = "remove `blocking: true`, or correct the addresses in its map"
            raise self._error("blocking", state, action) from error

    def blocking(self) -> Mapping[str, float]:
        """Return the positions of the blocking valves by signal, from 0 (open) to 1 (shut).

        A valve is at 0.5 if neither switch is on, NaN if both are.

        Raises:
            DriverError: the device does not reply, or not as expected.
        """
        read, at = self._client.read_discrete_inputs, self._registers.blocking_switches
        switches = self._read("blocking valves", read, at, 2 * len(BLOCKING))
        found = {}
        for i, signal in enumerate(BLOCKING):
            found[signal] = 1.0 - _BY_SWITCHES[switches[2 * i], switches[2 * i + 1]]
        return found

    def positions(self, bypasses: Sequence[str]) -> Mapping[str, float]:
        """Return the positions of the bypasses' valves by signal.

        A needle is at 0 to 1. A ball is at 0 (shut), 1 (open), 0.5 (neither switch is on) or NaN
        (both switches are on, so that one is broken).

        Raises:
            DriverError: the device does not reply, or not as expected.
        """
        count = 1 + max(BYPASSES.index(bypass) for bypass in bypasses)
        at, client = self._registers, self._client
        switches = self._read("switches", client.read_discrete_inputs, at.switches, 2 * count)
        needles = self._read("needles", client.read_input_registers, at.positions, count)
        found = {}
        for bypass in bypasses:
            i = BYPASSES.index(bypass)
            if bypass != THROTTLE:
                found[f"{bypass}_ball"] = _BY_SWITCHES[switches[2 * i], switches[2 * i + 1]]
            found[f"{bypass}_needle"] = needles[i] / NEEDLE_FULL_SCALE
        return found

    def _read(
        self, channel: str, request: Callable[..., ModbusPDU], first: int, count: int
    ) -> Sequence[Any]:
        """Return `count` values from an address on; those of switches are True or False."""
        reply = self._ask(channel, request, first, count=count)
        values = reply.bits or reply.registers
        if len(values) < count:
            state = f"{self._place} returns {len(values)} of {count} values"
            raise self._error(channel, state, "check that it is the device expected")
        # Bits come in whole bytes: there may be more than asked for.
        return values[:count]

    def _ask(
        self, channel: str, request: Callable[..., ModbusPDU], *args: Any, **options: Any
    ) -> ModbusPDU:
        if self.lost:  # pymodbus would connect again, to whatever is there by then
            raise self._error("", f"connection to {self._place} is lost", "open it again")
        try:
            reply = request(*args, device_id=self._unit, **options)
        except (ConnectionException, OSError) as error:
            self.close()
            state = f"connection to {self._place} is broken"
            raise self._error("", state, "check power and cable") from error
        except ModbusException as error:
            state = f"no valid reply from {self._place} in time"
            raise self._error("", state, "check power, cable and unit") from error
        if reply.isError():
            state = f"{self._place} refuses with Modbus exception {reply.exception_code}"
            raise self._error(channel, state, "check the addresses against the device's")
        return reply

    @property
    def _place(self) -> str:
        where = self._client.comm_params
        return f"{where.host}:{where.port}" if where.port else where.host

    def _error(self, channel: str, state: str, action: str) -> DriverError:
        return DriverError(self._driver, state, action, channel)
