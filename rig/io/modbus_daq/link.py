"""A connection to a Modbus device for all but samples: verifying, set-up, nulling, diagnosis."""

import logging
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from rig.io.driver import DriverError
from rig.plant import Quantity

from .compiled_exchange import OWNED, exception_name
from .register_map import WORDS, ExchangeMode, Register, RegisterMap, RegisterType, RegisterValue

# Errors of pymodbus are raised as DriverError, so that they need not be printed as well.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

GREATEST_RATE: Final = "greatest_rate_Hz"
"""Name of the fact of a map that holds the greatest rate which the device itself states, Hz."""

_TYPES: Final = {
    "U16": ModbusTcpClient.DATATYPE.UINT16,
    "I16": ModbusTcpClient.DATATYPE.INT16,
    "U32": ModbusTcpClient.DATATYPE.UINT32,
    "I32": ModbusTcpClient.DATATYPE.INT32,
    "F32": ModbusTcpClient.DATATYPE.FLOAT32,
}

_COMMANDED: Final = ("command_V", "valve_enable")
"""Outputs that are set to 0, in this order, on a device without a null request."""

_REPORTED: Final = ("device_command_V", "valve_enabled")
_POLL_S: Final = 0.002


@dataclass(frozen=True)
class ModbusDaqOptions:
    """Keys of the device in a rig file.

    Attributes:
        host: network name or address of the device.
        map: registers of the device, a file of `config/maps`.
        port: TCP port of the device.
        unit: Modbus unit id of the device.
        exchange: how samples are exchanged; if it is not given, the first way in the map.
        watchdog: time of the device's own watchdog, at least that of three exchanges, and within
            `shortest` and `longest` of the map's watchdog, such as 1 s at most for `io_node`;
            required if the map has a watchdog, and left out if it has none.
        rate: exchanges in a second; at most the rate of the map, which holds if it is not given.
        timeout: longest wait for a connection, or for a reply outside the loop.
        ownership: "required" unless the device is to be used without an owner, although its map has
            the registers for one: "none". Another master can then drive the valve unnoticed between
            two exchanges, and nothing but the watchdog notices that this one has stopped.
    """

    host: str
    map: RegisterMap
    port: Annotated[int, Quantity("", 1, 65535, "", "")] = 502
    unit: Annotated[int, Quantity("", 0, 255, "", "")] = 1
    exchange: ExchangeMode | None = None
    watchdog: Annotated[float | None, Quantity("s", 1e-3, 3600.0, "", "")] = None
    rate: Annotated[float | None, Quantity("Hz", 0.1, 1e4, "", "")] = None
    timeout: Annotated[float, Quantity("s", 0.01, 60.0, "", "")] = 1.0
    ownership: Literal["required", "none"] = "required"


_WATCH_S: Final = 0.1
"""Time in s for which another master is looked for: one that writes at 10 Hz or more is seen."""
_SPARE_S: Final = 0.2
"""Time in s for which claiming is tried beyond the watchdog's time, after which a device may be
claimed whose owner has died."""
_TRY_S: Final = 0.02


class RefusedError(DriverError):
    """Raised when a device answers a request with a Modbus exception; `code` is its code."""

    code: int = 0


class DaqLink:
    """A connection to the device for all but samples; making this object opens it.

    Args:
        driver: name of the driver, for error messages.
        options: the driver's section in the rig file.

    Raises:
        DriverError: no device answers there.
    """

    def __init__(self, driver: str, options: ModbusDaqOptions) -> None:
        self._driver, self._options, self._map = driver, options, options.map
        self._place = f"{options.host}:{options.port}"
        self._device = f"{self._map.device} at {self._place}"
        self._order: Any = "big" if self._map.word_order == "high_first" else "little"
        self._client = ModbusTcpClient(
            options.host, port=options.port, timeout=options.timeout, retries=0
        )
        if not self._client.connect():
            state = f"{self._device} cannot be reached within {options.timeout:g} s"
            raise DriverError(driver, state, "check power, cable, host and port")

    def close(self) -> None:
        """Close the connection; repeated calls do no harm."""
        self._client.close()

    def verify(self, rate_hz: float) -> None:
        """Check that the device is that of the map, and that it can exchange at `rate_hz`.

        Raises:
            DriverError: its identity or map version is another one, it states a greatest rate below
                `rate_hz`, or it gives no valid reply.
        """
        self._verify_register("identity", self._map.identity)
        if self._map.version is not None:
            self._verify_register("map version", self._map.version)
        for fact in self._map.facts:
            if fact.name == GREATEST_RATE:
                greatest = self.read(fact.address, fact.type)
                if rate_hz > greatest:
                    state = f"{self._place} does {greatest:g} exchanges/s, not {rate_hz:g}"
                    raise DriverError(self._driver, state, f"write rate: {greatest:g} Hz", "rate")

    def _verify_register(self, what: str, expected: RegisterValue) -> None:
        try:
            found = self.read(expected.address, expected.type)
            if found == expected.value:
                return
            instead = f"{found:g}"
        except RefusedError as refusal:
            instead = refusal.state.removeprefix(f"{self._device} refuses with ")
        state = (
            f"{self._place} is not the {self._map.device} expected: its {what} is {instead} "
            f"instead of {expected.value:g}"
        )
        channel = f"register {expected.address}"
        raise DriverError(self._driver, state, "check host, port and map", channel)

    def set_up(self) -> None:
        """Write the set-up of map and watchdog and check it, unless the device holds it already.

        A register that is written more than once must hold the last of its values.

        Raises:
            DriverError: the device refuses, gives no valid reply, or does not hold the values after
                they were written.
        """
        values = [*self._map.setup]
        watchdog, watchdog_s = self._map.watchdog, self._options.watchdog
        if watchdog is not None and watchdog_s is not None:
            counts = round(watchdog_s * watchdog.counts_per_s)
            values += [RegisterValue(watchdog.address, watchdog.type, counts), *watchdog.arm]
        last = {value.address: value for value in values}.values()
        if all(self._holds(value) for value in last):
            return
        for value in values:
            self._write(value)
        for value in last:
            found = self.read(value.address, value.type)
            if found != value.value:
                state = f"{self._map.device} was given {value.value:g} and has {found:g}"
                channel = f"register {value.address}"
                raise DriverError(self._driver, state, "check the map's set-up", channel)

    def require_no_other_master(self) -> None:
        """Check that nobody writes to the device now, if its `host_counter` can be read back.

        Raises:
            DriverError: somebody does, or the device gives no valid reply.
        """
        counters = [
            register
            for register in self._map.written
            if register.signal == "host_counter" and register.access == "rw"
        ]
        for register in counters:
            first = self.read(register.address, register.type)
            until = time.monotonic() + _WATCH_S
            while time.monotonic() < until:
                time.sleep(_TRY_S)
                if self.read(register.address, register.type) != first:
                    state = f"{self._device} is driven by another master: its counter goes on"
                    raise DriverError(self._driver, state, "end the program that drives it")

    def claim(self, key: int) -> None:
        """Own the device by a key, 1 to 32767; wait for the end of an owner that has died.

        Raises:
            DriverError: the device is owned by another master, has no registers of an owner, or
                gives no valid reply.
        """
        assert self._map.owner is not None
        until = time.monotonic() + (self._options.watchdog or 0.0) + _SPARE_S
        while True:
            try:
                self._write(RegisterValue(self._map.owner.claim, "U16", key))
                return
            except RefusedError as refusal:
                if refusal.code != OWNED:
                    state = f"{self._device} has no register {self._map.owner.claim} of an owner"
                    remedy = (
                        "update it (docs/io_node.md, Ownership), or write `ownership: none`, by "
                        "which another master is no longer kept from driving the valve"
                    )
                    raise DriverError(self._driver, state, remedy, "ownership") from refusal
                if time.monotonic() > until:
                    state = f"{self._device} is owned by another master, which is alive"
                    action = "end the program that drives it"
                    raise DriverError(self._driver, state, action) from refusal
            time.sleep(_TRY_S)

    def release(self, key: int) -> None:
        """Give the device up; its relay opens.

        Raises:
            DriverError: this program does not own it, or the device gives no valid reply.
        """
        assert self._map.owner is not None
        self._write(RegisterValue(self._map.owner.release, "U16", key))

    def null(self) -> None:
        """Bring the valve to 0 V and switch it off, and wait until the device confirms it.

        It confirms by its null request, if the map has one, and by every quantity that it reports
        of the valve: its output, and whether the valve is enabled. Each must be exactly 0.

        Raises:
            DriverError: the device gave no valid reply, refused, or did not confirm in the time
                `timeout` of the options.
        """
        refusals = []
        for value in self._requests():
            try:
                self._write(value)
            except DriverError as refusal:  # an output that fails must not keep the relay closed
                refusals.append(refusal)
        if refusals:
            raise refusals[0]
        timeout_s = self._options.timeout
        deadline = time.monotonic() + timeout_s
        while waiting := self._waiting():
            if time.monotonic() > deadline:
                state = f"{self._map.device} was asked for null and after {timeout_s:g} s {waiting}"
                action = "cut the hydraulic supply, then find out why"
                raise DriverError(self._driver, state, action)
            time.sleep(_POLL_S)

    def _requests(self) -> list[RegisterValue]:
        """Return the values whose writing brings the valve to null, in order."""
        if self._map.null_request is not None:
            return [self._map.null_request]
        registers = {register.signal: register for register in self._map.written}
        nulled = [registers[signal] for signal in _COMMANDED if signal in registers]
        return [RegisterValue(r.address, r.type, _number_at_zero(r)) for r in nulled]

    def _waiting(self) -> str:
        """Return a text that says why the valve is not yet at null; empty if it is."""
        request = self._map.null_request
        if request is not None and not self._holds(request):
            return "has not taken the request"
        not_null = next(self.driven(), "")
        return f"still {not_null}" if not_null else ""

    def driven(self) -> Iterator[str]:
        """Yield a text for each quantity of the valve that the device reports and that is not 0.

        On a device without a null request, outputs that can be read back count as well.

        Raises:
            DriverError: the device gives no valid reply, or refuses.
        """
        for register in self._map.registers:
            counts = register.signal in _REPORTED
            if self._map.null_request is None:
                counts |= register.access == "rw" and register.signal in _COMMANDED
            if counts and (value := self._value_of(register)) != 0.0:
                yield f"has {register.signal} at {value:g}"

    def _value_of(self, register: Register) -> float:
        number = self.read(register.address, register.type)
        if register.bit is not None:
            number = int(number) >> register.bit & 1
        return register.gain * number + register.bias

    def read(self, address: int, kind: RegisterType) -> float:
        """Return the number that a register holds, not scaled.

        Raises:
            RefusedError: the device refuses.
            DriverError: the device gives no valid reply.
        """
        words = WORDS[kind]
        reply = self._answered(self._client.read_holding_registers, address, count=words)
        if len(reply.registers) != words:
            state = f"{self._device} returns {len(reply.registers)} registers instead of {words}"
            raise DriverError(self._driver, state, "check the map", f"register {address}")
        number: Any = self._client.convert_from_registers(
            reply.registers, _TYPES[kind], word_order=self._order
        )
        return float(number)

    def _write(self, value: RegisterValue) -> None:
        """Write the number of `value` into its register, rounded unless the register is F32."""
        number = value.value if value.type == "F32" else round(value.value)
        registers = self._client.convert_to_registers(
            number, _TYPES[value.type], word_order=self._order
        )
        self._answered(self._client.write_registers, value.address, values=registers)

    def _holds(self, value: RegisterValue) -> bool:
        """Return whether the register of `value` holds exactly the number of `value`."""
        return self.read(value.address, value.type) == value.value

    def _answered(self, request: Callable[..., ModbusPDU], address: int, **more: Any) -> ModbusPDU:
        channel = f"register {address}"
        try:
            reply = request(address, device_id=self._options.unit, **more)
        except (ModbusException, OSError) as error:
            state = f"{self._device} gives no valid reply"
            raise DriverError(self._driver, state, "check cable and unit id", channel) from error
        if reply.isError():
            state = f"{self._device} refuses with {exception_name(reply.exception_code)}"
            refused = RefusedError(self._driver, state, "check the map", channel)
            refused.code = reply.exception_code
            raise refused
        return reply


def _number_at_zero(register: Register) -> float:
    """Return the number that a register holds if its signal is 0.

    For a switch it is the number of the whole register, with all other bits 0.
    """
    number = (0.0 - register.bias) / register.gain
    return number * (1 << register.bit) if register.bit is not None else number
