"""The generic I/O node of docs/io_node.md as a Modbus device, around the emulated plant.

It takes a sample whenever its read block is read. Its watchdog acts as of its deadline, even if the
emulator notices that only later. A master may own it (`rig.emulator.modbus.owner`).
"""

import secrets
from collections.abc import Callable
from enum import IntFlag
from math import isfinite, isnan
from struct import Struct
from typing import Final

from rig.emulator.instruments import CARRIED, Instruments
from rig.emulator.plant import COMMAND_RANGE
from rig.emulator.record import Record

from .functions import BUSY, ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusException
from .io_device import IoDevice
from .owner import Owner

WRITE_BLOCK: Final = 0
READ_BLOCK: Final = 256
SETUP_BLOCK: Final = 512
OWNER_BLOCK: Final = 640
NULL_REQUEST: Final = 768
_WATCHDOG: Final = SETUP_BLOCK + 2

IDENTITY: Final = 0x5249
MAP_VERSION: Final = 1
GREATEST_RATE_HZ: Final = 1000
WATCHDOG_MS: Final = 100
WATCHDOG_LIMIT_MS: Final = 1000

_WRITTEN: Final = Struct(">HHfH")
_HEARTBEAT_AT: Final = _WRITTEN.size - 2
"""Byte of the write block at which the register of the owner's heartbeat begins."""
_READ: Final = Struct(f">HHHHIiffffff{len(CARRIED)}f")
_SETUP: Final = Struct(">HHHHHH")
_BLOCKS: Final = {
    WRITE_BLOCK: _WRITTEN.size // 2,
    READ_BLOCK: _READ.size // 2,
    SETUP_BLOCK: _SETUP.size // 2,
    OWNER_BLOCK: 2,
    NULL_REQUEST: 1,
}
"""Number of registers of each block, by the block's first address."""


class Control(IntFlag):
    """Bits that the host writes."""

    VALVE_ENABLE = 1
    """The valve's relay may close."""
    REARM = 2
    """Its rising edge acknowledges a watchdog that has tripped."""
    RESET_LAMP = 4
    """The reset lamp is lit."""


class Status(IntFlag):
    """Bits that the node reports."""

    ESTOP_CLOSED = 1
    """The emergency stop's chain is closed."""
    RESET_BUTTON = 2
    """The reset button is pressed."""
    VALVE_ENABLED = 4
    """The valve's relay is closed."""
    WATCHDOG_TRIPPED = 8
    """The watchdog has tripped, and was not acknowledged."""
    ENCODER_FAULT = 16
    """The encoder has lost counts, or gives no position."""


class IoNode(IoDevice):
    """Registers, enable sequence and watchdog of the node.

    Args:
        instruments: the transducers wired to it.
        valve: called with the voltage of the valve output and the time in ns from which it acts.
        record: takes note of what happens.
        power_up_id: number in register 516; random if it is None or 0.
    """

    functions = frozenset((3, 4, 6, 16, 23, 76))

    def __init__(
        self,
        instruments: Instruments,
        valve: Callable[[float, int], None],
        record: Record,
        power_up_id: int | None = None,
    ) -> None:
        super().__init__(instruments, valve, record)
        self._power_up_id = power_up_id or 1 + secrets.randbelow(0xFFFF)
        self._power_up_ns = self._clock()
        self._resolution = instruments.plant.sensors.position_resolution
        self._image = bytearray(_WRITTEN.size)
        self._sample = bytes(_READ.size)
        self._watchdog_ms = WATCHDOG_MS
        self._host_counter = 0
        self._counted_ns = self._fed_ns = self._power_up_ns
        self._control = Control(0)
        self._command = 0.0
        self._latched = True
        self._null_requested = False
        self._owner = Owner(record)

    def has(self, address: int, count: int) -> bool:
        """Return whether one block has all of the `count` registers from `address` on."""
        return self._block(address, count) is not None

    def _block(self, address: int, count: int) -> int | None:
        """Return the first address of the block that has all these registers; None if none has."""
        for start, size in _BLOCKS.items():
            if start <= address and address + count <= start + size:
                return start
        return None

    def read(self, address: int, count: int) -> bytes:
        """Return registers, high byte first; take a new sample if they are of the read block.

        While the device is `frozen`, no new sample is taken.

        Raises:
            ModbusException: there are no such registers.
        """
        start = self._block(address, count)
        if start is None:
            raise ModbusException(ILLEGAL_ADDRESS)
        if start == READ_BLOCK:
            block = self._sampled()
        elif start == WRITE_BLOCK:
            block = bytes(self._image)
        elif start == SETUP_BLOCK:
            block = self._setup()
        elif start == OWNER_BLOCK:
            block = bytes((0, self._owner.is_there, 0, 0))
        else:
            block = self._null_requested.to_bytes(2, "big")
        offset = 2 * (address - start)
        return block[offset : offset + 2 * count]

    def write(self, address: int, data: bytes) -> None:
        """Write registers, high byte first: all of them, or none if an exception is raised.

        Raises:
            ModbusException: there are no such registers to write, or a value is refused.
        """
        offset = 2 * address
        if offset >= 0 and offset + len(data) <= _WRITTEN.size:
            self._take(offset, data)
        elif address in (OWNER_BLOCK, OWNER_BLOCK + 1) and len(data) == 2:
            self._change_owner(int.from_bytes(data, "big"), claims=address == OWNER_BLOCK)
        elif address == _WATCHDOG and len(data) == 2:
            self._set_watchdog(int.from_bytes(data, "big"))
        elif address == NULL_REQUEST and len(data) == 2:
            self._request_null(int.from_bytes(data, "big"))
        else:
            raise ModbusException(ILLEGAL_ADDRESS)

    def _take(self, offset: int, data: bytes) -> None:
        """Act on data that the host wrote from byte `offset` of the write block on.

        Raises:
            ModbusException: the command is not finite, or another master owns the node; nothing is
                changed then.
        """
        image = self._image.copy()
        image[offset : offset + len(data)] = data
        counter, bits, command, beat = _WRITTEN.unpack(image)
        image[_HEARTBEAT_AT:] = bytes(2)
        if not isfinite(command):
            raise ModbusException(ILLEGAL_VALUE)
        now = self.tend()
        has_beat = offset + len(data) > _HEARTBEAT_AT
        if not self._owner.may_write(beat if has_beat else None, now):
            raise ModbusException(BUSY)
        control = Control(bits & 7)
        risen = control & ~self._control
        if counter != self._host_counter and self._owner.beats:
            self._counted_ns = self._fed_ns = now
        if Control.VALVE_ENABLE in risen:
            self._fed_ns = now
        self._image, self._host_counter = image, counter
        self._control, self._command = control, command
        if Control.REARM in risen and self._tripped and now - self._counted_ns < self._watchdog_ns:
            self._tripped = False
            self._record.note("watchdog_rearmed", now)
        self.exchanges += 1
        self._settle("host", now)
        self._record.command(now, command, self._output, self.enabled)

    @property
    def _watchdog_ns(self) -> int:
        return self._watchdog_ms * 1_000_000

    def tend(self) -> int:
        """Make the watchdog trip if its time is over, and return the present in ns.

        It trips only while the host sets `VALVE_ENABLE`.
        """
        now = self._clock()
        armed = Control.VALVE_ENABLE in self._control and not self._tripped
        deadline = self._fed_ns + self._watchdog_ns
        if armed and now >= deadline:
            self._tripped = self._latched = True
            self._record.note("watchdog_trip", deadline, host_counter=self._host_counter)
            self._settle("watchdog", deadline)
        return now

    def _asked(self) -> tuple[bool, float, float]:
        asked = Control.VALVE_ENABLE in self._control
        allowed = asked and not self._latched and not self._tripped
        return allowed, self._command, min(max(self._command, -COMMAND_RANGE), COMMAND_RANGE)

    def _change_owner(self, key: int, *, claims: bool) -> None:
        """Let a master own the node by a key, or let it give the node up; the relay opens.

        Raises:
            ModbusException: the key is none, or another master owns the node.
        """
        now = self.tend()
        if claims:
            self._owner.claim(key, now, self._watchdog_ns)
        else:
            self._owner.release(key, now)
        self._image = bytearray(_WRITTEN.size)
        self._control, self._command = Control(0), 0.0
        self._settle("owner", now)

    def _set_watchdog(self, watchdog_ms: int) -> None:
        if not 0 < watchdog_ms <= WATCHDOG_LIMIT_MS:
            raise ModbusException(ILLEGAL_VALUE)
        if self._owner.is_there and Control.VALVE_ENABLE in self._control:
            raise ModbusException(BUSY)
        self.tend()
        self._watchdog_ms = watchdog_ms
        self._record.note("watchdog_set", watchdog_ms=watchdog_ms)

    def _request_null(self, value: int) -> None:
        if value != 1:
            raise ModbusException(ILLEGAL_VALUE)
        now = self.tend()
        self._null_requested = self._latched = True
        self._record.note("null_request", now)
        self._settle("null_request", now)

    def press_estop(self, pressed: bool) -> None:
        """Open the emergency stop's chain, which latches the node, or close the chain again."""
        self._latched = self._latched or pressed
        super().press_estop(pressed)

    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or release it.

        A press resets the latch if the lamp is lit and the emergency stop's chain is closed.
        """
        now = self.tend()
        rising = pressed and not self._button
        self._button = pressed
        if rising and self.lamp and self.estop_closed and self._latched:
            self._latched = self._null_requested = False
            self._record.note("reset", now)
            self._settle("reset", now)

    @property
    def lamp(self) -> bool:
        """Whether the reset lamp is lit."""
        return Control.RESET_LAMP in self._control

    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
        return {
            "exchanges": self.exchanges,
            "host_counter": self._host_counter,
            "command_V": self._command,
            "output_V": self._output,
            "valve_enabled": self.enabled,
            "estop_closed": self.estop_closed,
            "watchdog_tripped": self._tripped,
            "watchdog_ms": self._watchdog_ms,
            "null_requested": self._null_requested,
            "latched": self._latched,
            "reset_lamp": self.lamp,
            "connections": self.connections,
            "owned": self._owner.is_there,
            "refused_writes": self._owner.refused,
            "power_up_id": self._power_up_id,
        }

    def _status(self, encoder_lost: bool) -> int:
        return (
            Status.ESTOP_CLOSED * self.estop_closed
            | Status.RESET_BUTTON * self._button
            | Status.VALVE_ENABLED * self.enabled
            | Status.WATCHDOG_TRIPPED * self._tripped
            | Status.ENCODER_FAULT * (self._encoder_fault or encoder_lost)
        )

    def _sampled(self) -> bytes:
        """Return the read block with a new sample, or with the last one while frozen."""
        if self.frozen:
            return self._sample
        now = self.tend()
        reading = self._instruments.read()
        self._samples = (self._samples + 1) & 0xFFFF
        lost = isnan(reading.position)
        counts = 0 if lost else round(reading.position / self._resolution) - self._zero
        self._sample = _READ.pack(
            self._samples, self._status(lost), self._host_counter, self._owner.told,
            (now - self._power_up_ns) // 1000 & 0xFFFFFFFF, counts,
            1e-3 * reading.pressure_1, 1e-3 * reading.pressure_2, 1e-3 * reading.supply_pressure,
            1e6 * reading.spool, reading.load, self._output,
            *self._instruments.read_carried().values(),
        )  # fmt: skip
        return self._sample

    def _setup(self) -> bytes:
        return _SETUP.pack(
            IDENTITY, MAP_VERSION, self._watchdog_ms, GREATEST_RATE_HZ, self._power_up_id,
            min(self.connections, 0xFFFF),
        )  # fmt: skip
