"""A connection to a Modbus device by which set-up, diagnosis and nulling use single registers."""

import logging
from types import TracebackType
from typing import Any, Final

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ModbusPDU

from rig.io.driver import DriverError

from .compiled_exchange import exception_name
from .register_map import WORDS, RegisterMap, RegisterType, RegisterValue

# Errors of pymodbus are raised as DriverError, so that they need not be printed as well.
logging.getLogger("pymodbus").addHandler(logging.NullHandler())

_TYPES: Final = {
    "U16": ModbusTcpClient.DATATYPE.UINT16,
    "I16": ModbusTcpClient.DATATYPE.INT16,
    "U32": ModbusTcpClient.DATATYPE.UINT32,
    "I32": ModbusTcpClient.DATATYPE.INT32,
    "F32": ModbusTcpClient.DATATYPE.FLOAT32,
}


class RefusedError(DriverError):
    """Raised when a device answers a request with a Modbus exception.

    Attributes:
        exception: code and name of the exception.
    """

    def __init__(self, driver: str, device: str, channel: str, code: int) -> None:
        self._arguments = driver, device, channel, code
        self.exception = exception_name(code)
        state = f"{device} refuses with {self.exception}"
        super().__init__(driver, state, "check the map", channel)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), self._arguments


class DaqLink:
    """One connection, which is opened when it is made and closed at the end of its `with` block.

    Args:
        driver: name of the driver, for error messages.
        host: network name or address of the device.
        port: TCP port of the device.
        unit: Modbus unit id of the device.
        register_map: map of the device, for its name and its word order.
        timeout_s: longest time in s for the connection, and for each reply.

    Attributes:
        driver: name of the driver.
        place: host and port.

    Raises:
        DriverError: no device answers there.
    """

    def __init__(
        self,
        driver: str,
        host: str,
        port: int,
        unit: int,
        register_map: RegisterMap,
        timeout_s: float,
    ) -> None:
        self.driver, self._unit = driver, unit
        self.place = f"{host}:{port}"
        self._device = f"{register_map.device} at {self.place}"
        self._order: Any = "big" if register_map.word_order == "high_first" else "little"
        self._client = ModbusTcpClient(host, port=port, timeout=timeout_s, retries=0)
        if not self._client.connect():
            raise DriverError(
                driver,
                f"{self._device} cannot be reached within {timeout_s:g} s",
                "check power, cable, host and port",
            )

    def __enter__(self) -> "DaqLink":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._client.close()

    def read(self, address: int, kind: RegisterType) -> float:
        """Return the number that a register holds, not scaled.

        Raises:
            RefusedError: the device refuses.
            DriverError: the device gives no valid reply.
        """
        words = WORDS[kind]
        reply = self._answered(
            address,
            lambda: self._client.read_holding_registers(address, count=words, device_id=self._unit),
        )
        if len(reply.registers) != words:
            state = f"{self._device} returns {len(reply.registers)} registers instead of {words}"
            raise DriverError(self.driver, state, "check the map", f"register {address}")
        number: Any = self._client.convert_from_registers(
            reply.registers, _TYPES[kind], word_order=self._order
        )
        return float(number)

    def write(self, value: RegisterValue) -> None:
        """Write the number of `value` into its register, rounded unless the register is F32.

        Raises:
            RefusedError: the device refuses.
            DriverError: the device gives no valid reply.
        """
        number = value.value if value.type == "F32" else round(value.value)
        registers = self._client.convert_to_registers(
            number, _TYPES[value.type], word_order=self._order
        )
        self._answered(
            value.address,
            lambda: self._client.write_registers(value.address, registers, device_id=self._unit),
        )

    def holds(self, value: RegisterValue) -> bool:
        """Return whether the register of `value` holds exactly the number of `value`.

        Raises:
            RefusedError: the device refuses.
            DriverError: the device gives no valid reply.
        """
        return self.read(value.address, value.type) == value.value

    def _answered(self, address: int, request: Any) -> ModbusPDU:
        channel = f"register {address}"
        try:
            reply: ModbusPDU = request()
        except (ModbusException, OSError) as error:
            state = f"{self._device} gives no valid reply"
            raise DriverError(self.driver, state, "check cable and unit id", channel) from error
        if reply.isError():
            raise RefusedError(self.driver, self._device, channel, reply.exception_code)
        return reply
