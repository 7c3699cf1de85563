"""A connection to the I/O device of the bypass valves, through pymodbus."""

import logging
from collections.abc import Callable, Mapping, Sequence
from math import nan
from typing import Any, Final, TypeVar

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ConnectionException, ModbusException
from pymodbus.pdu import ModbusPDU

from rig.channels import BYPASSES
from rig.io.driver import DriverError

from .registers import IDENTITY, NEEDLE_FULL_SCALE, THROTTLE, BypassRegisters

Client = ModbusTcpClient | ModbusSerialClient

# Errors of pymodbus are raised as DriverError, so that they need not be printed as well.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_Value = TypeVar("_Value")

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
            raise self._error(
                "", f"cannot connect to {self._place}", "check power, cable, address, other users"
            )
        try:
            self._verify_identity()
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
        """Set the time in s without requests after which the device shuts the valves; 0: never.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        milliseconds = round(time_s * 1e3)
        self._ask("watchdog", self._client.write_register, self._registers.watchdog, milliseconds)

    def set_ball(self, bypass: str, opened: bool) -> None:
        """Command a ball valve to open or to shut, without waiting for its move.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        address = self._registers.coils + BYPASSES.index(bypass)
        self._ask(f"{bypass}_ball", self._client.write_coil, address, opened)

    def shut_balls(self, bypasses: Sequence[str]) -> None:
        """Command the balls from the first of `BYPASSES` to the last given to shut, in one request.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        shut = [False] * (1 + max(BYPASSES.index(bypass) for bypass in bypasses))
        self._ask("balls", self._client.write_coils, self._registers.coils, shut)

    def set_needle(self, bypass: str, opening: float) -> None:
        """Command a needle valve to an opening, 0 to 1, without waiting for its move.

        Raises:
            DriverError: the device does not reply, or refuses.
        """
        address = self._registers.setpoints + BYPASSES.index(bypass)
        setpoint = round(opening * NEEDLE_FULL_SCALE)
        self._ask(f"{bypass}_needle", self._client.write_register, address, setpoint)

    def positions(self, bypasses: Sequence[str]) -> Mapping[str, float]:
        """Return the positions of the bypasses' valves by signal.

        A needle is at 0 to 1. A ball is at 0 (shut), 1 (open), 0.5 (neither switch is on) or NaN
        (both switches are on, so that one is broken).

        Raises:
            DriverError: the device does not reply, or not as expected.
        """
        count = 1 + max(BYPASSES.index(bypass) for bypass in bypasses)
        switches = self._read_switches(2 * count)
        needles = self._read_needles(count)
        found = {}
        for bypass in bypasses:
            i = BYPASSES.index(bypass)
            if bypass != THROTTLE:
                found[f"{bypass}_ball"] = _BY_SWITCHES[switches[2 * i], switches[2 * i + 1]]
            found[f"{bypass}_needle"] = needles[i] / NEEDLE_FULL_SCALE
        return found

    def _read_switches(self, count: int) -> Sequence[bool]:
        first = self._registers.switches
        reply = self._ask("switches", self._client.read_discrete_inputs, first, count=count)
        return self._complete("switches", reply.bits, count)

    def _read_needles(self, count: int) -> Sequence[int]:
        first = self._registers.positions
        reply = self._ask("needles", self._client.read_input_registers, first, count=count)
        return self._complete("needles", reply.registers, count)

    def _verify_identity(self) -> None:
        address = self._registers.identity
        reply = self._ask("identity", self._client.read_holding_registers, address, count=1)
        (identity,) = self._complete("identity", reply.registers, 1)
        if identity != IDENTITY:
            raise self._error(
                "identity",
                f"{self._place} is 0x{identity:04x} and not 0x{IDENTITY:04x}",
                "check the address: another device answers",
            )

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

    def _complete(self, channel: str, values: Sequence[_Value], count: int) -> Sequence[_Value]:
        if len(values) < count:
            state = f"{self._place} returns {len(values)} of {count} values"
            raise self._error(channel, state, "check that it is the device expected")
        # Bits come in whole bytes: there may be more than asked for.
        return values[:count]

    @property
    def _place(self) -> str:
        where = self._client.comm_params
        return f"{where.host}:{where.port}" if where.port else where.host

    def _error(self, channel: str, state: str, action: str) -> DriverError:
        return DriverError(self._driver, state, action, channel)
