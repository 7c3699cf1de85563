"""An I/O device with the registers of a map, such as a LabJack T7 (docs/labjack.md).

Unlike the generic I/O node it latches nothing: the valve's relay is closed while `valve_enable` is
set and the emergency stop's chain is closed. If no request at all comes for the watchdog's time,
the watchdog opens the relay until the next command.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isnan
from struct import pack, unpack
from typing import Final, Literal

from rig.channels import READINGS
from rig.emulator.instruments import Instruments
from rig.emulator.record import Record
from rig.io import WORDS, Fact, Register, RegisterMap, RegisterValue, Watchdog

from .functions import ILLEGAL_ADDRESS, ILLEGAL_VALUE, ModbusException
from .io_device import IoDevice

_FUNCTIONS: Final = {"fc23": 23, "fc76": 76}
_FORMATS: Final = {"U16": ">H", "I16": ">h", "U32": ">I", "I32": ">i", "F32": ">f"}
_RANGES: Final = {
    "U16": (0, 0xFFFF),
    "I16": (-0x8000, 0x7FFF),
    "U32": (0, 0xFFFF_FFFF),
    "I32": (-0x8000_0000, 0x7FFF_FFFF),
}


Place = Register | RegisterValue | Fact | Watchdog
"""Descriptions of a number in one or two registers; each has an address and a type."""


@dataclass(frozen=True)
class RegisterCode:
    """Converts numbers to the contents of registers, and back.

    Attributes:
        word_order: order of the two words of a number of 32 bits.
    """

    word_order: Literal["high_first", "low_first"]

    def number(self, place: Place, words: Mapping[int, int]) -> float:
        """Return the number in the registers of a place, unscaled, given all words by address."""
        halves = [words[at].to_bytes(2, "big") for at in addresses(place)]
        return float(unpack(_FORMATS[place.type], b"".join(self._ordered(halves)))[0])

    def words(self, place: Place, number: float) -> dict[int, int]:
        """Return the words, by address, that hold a number in the registers of a place.

        Unless the type is F32, the number is rounded, and limited to the range of the type.
        """
        if place.type != "F32":
            low, high = _RANGES[place.type]
            number = min(max(round(number), low), high)
        data = pack(_FORMATS[place.type], number)
        halves = self._ordered([data[i : i + 2] for i in range(0, len(data), 2)])
        return {place.address + i: int.from_bytes(half, "big") for i, half in enumerate(halves)}

    def _ordered(self, halves: list[bytes]) -> Iterable[bytes]:
        return halves if self.word_order == "high_first" else halves[::-1]


def addresses(place: Place) -> range:
    """Return the addresses of the one or two registers that a place takes."""
    return range(place.address, place.address + WORDS[place.type])


class MappedDevice(IoDevice):
    """A device with the registers of a map; registers of the set-up keep what is written to them.

    Args:
        register_map: map of the device's registers.
        instruments: the transducers wired to it.
        valve: called with the voltage at the valve and the time in ns from which it acts.
        record: takes note of what happens.
    """

    def __init__(
        self,
        register_map: RegisterMap,
        instruments: Instruments,
        valve: Callable[[float, int], None],
        record: Record,
    ) -> None:
        super().__init__(instruments, valve, record)
        modes = {_FUNCTIONS[mode] for mode in register_map.exchange if mode in _FUNCTIONS}
        self.functions = frozenset({3, 4, 6, 16} | modes)
        self._map = register_map
        self._code = RegisterCode(register_map.word_order)
        self._inputs = {a for r in register_map.read for a in addresses(r)}
        self._outputs = {a for r in register_map.written for a in addresses(r)}
        self._words = self._initial()
        self._given = {register.signal: 0.0 for register in register_map.written}
        self.enabled = "valve_enable" not in self._given
        self._heard_ns = self._clock()

    def _initial(self) -> dict[int, int]:
        """Return the contents of all registers at power-up, by address."""
        known = self._map
        watchdog = known.watchdog
        armed: tuple[Place, ...] = () if watchdog is None else (watchdog, *watchdog.arm)
        places: tuple[Place, ...] = (*known.registers, *known.setup, *armed, *known.facts)
        words = {at: 0 for place in places for at in addresses(place)}
        for value in (known.identity, known.version):
            if value is not None:
                words |= self._code.words(value, value.value)
        return words

    def has(self, address: int, count: int) -> bool:
        """Return whether `count` registers from `address` on can be read."""
        return self._words.keys() >= set(range(address, address + count))

    def read(self, address: int, count: int) -> bytes:
        """Return registers, high byte first; take a new sample if an input is among them.

        While the device is `frozen`, no new sample is taken.

        Raises:
            ModbusException: there are no such registers.
        """
        if not self.has(address, count):
            raise ModbusException(ILLEGAL_ADDRESS)
        asked = range(address, address + count)
        self._hear()
        if not self.frozen and not self._inputs.isdisjoint(asked):
            self._sample()
        return b"".join(self._words[at].to_bytes(2, "big") for at in asked)

    def write(self, address: int, data: bytes) -> None:
        """Write registers, high byte first: all of them, or none if an exception is raised.

        Raises:
            ModbusException: there are no such registers to write, or an output is NaN.
        """
        written = {address + i: (data[2 * i] << 8) + data[2 * i + 1] for i in range(len(data) // 2)}
        if not written.keys() <= self._words.keys() - (self._inputs - self._outputs):
            raise ModbusException(ILLEGAL_ADDRESS)
        words = self._words | written
        given = {r.signal: self._decoded(r, words) for r in self._map.written}
        if any(isnan(value) for value in given.values()):
            raise ModbusException(ILLEGAL_VALUE)
        now = self._hear()
        self._words = words
        if not self._outputs.isdisjoint(written):
            self._take(given, now)

    def _take(self, given: dict[str, float], now: int) -> None:
        """Act on outputs in SI by signal, which the host has written at `now` in ns.

        A watchdog that has tripped no longer counts as tripped.
        """
        self._given = given
        self._tripped = False
        self.exchanges += 1
        self._settle("host", now)
        self._record.command(now, given["command_V"], self._output, self.enabled)

    def _asked(self) -> tuple[bool, float, float]:
        asked = bool(self._given.get("valve_enable", 1.0))
        command = self._given["command_V"]
        return asked and not self._tripped, command, command

    def _hear(self) -> int:
        """Restart the watchdog's time, since the host sent a request; return the present in ns.

        A watchdog whose time was over trips first.
        """
        self._heard_ns = self.tend()
        return self._heard_ns

    def tend(self) -> int:
        """Make the watchdog trip if its time is over, and return the present in ns."""
        now, timeout_ns = self._clock(), self._watchdog_ns()
        deadline = self._heard_ns + timeout_ns
        if timeout_ns and not self._tripped and now >= deadline:
            self._tripped = True
            self._record.note("watchdog_trip", deadline)
            self._settle("watchdog", deadline)
        return now

    def _watchdog_ns(self) -> int:
        """Return the silence of the host in ns after which the watchdog trips; 0 if it never does.

        It never does if the map has no watchdog, or if one of the registers by which it is armed
        does not hold its value.
        """
        watchdog = self._map.watchdog
        if watchdog is None:
            return 0
        for value in watchdog.arm:
            coded = self._code.words(value, value.value)
            if any(self._words[at] != word for at, word in coded.items()):
                return 0
        counts = self._code.number(watchdog, self._words)
        return round(1e9 * counts / watchdog.counts_per_s)

    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or release it; the device only reports it."""
        if pressed and not self._button:
            self._record.note("reset")
        self._button = pressed

    @property
    def lamp(self) -> bool:
        """Whether the reset lamp is lit."""
        return bool(self._given.get("reset_lamp", 0.0))

    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
        return {
            "exchanges": self.exchanges,
            "command_V": self._given["command_V"],
            "output_V": self._output,
            "valve_enabled": self.enabled,
            "estop_closed": self.estop_closed,
            "watchdog_tripped": self._tripped,
            "watchdog_ms": self._watchdog_ns() // 1_000_000,
            "reset_lamp": self.lamp,
            "connections": self.connections,
        }

    def _sample(self) -> None:
        """Take a sample of all inputs, and write it into the registers."""
        found = self._found()
        words = dict.fromkeys(self._inputs, 0)
        for register in self._map.read:
            number = (found[register.signal] - register.bias) / register.gain
            number = 0.0 if isnan(number) and register.type != "F32" else number
            if register.bit is not None:
                words[register.address] |= (number >= 0.5) << register.bit
            else:
                words |= self._code.words(register, number)
        self._words |= words

    def _found(self) -> dict[str, float]:
        """Return a new sample of all signals that a fast driver may read, SI."""
        found: dict[str, float] = dict(zip(READINGS, self._instruments.read(), strict=True))
        self._samples = (self._samples + 1) & 0xFFFF
        resolution = self._instruments.plant.sensors.position_resolution
        return {
            **found,
            **self._instruments.read_carried(),
            "position_m": found["position_m"] - resolution * self._zero,
            "estop_closed": float(self.estop_closed),
            "reset_button": float(self._button),
            "valve_enabled": float(self.enabled),
            "watchdog_tripped": float(self._tripped),
            "encoder_fault": float(self._encoder_fault),
            "device_counter": float(self._samples),
            "device_echo": self._given.get("host_counter", 0.0),
            "device_command_V": self._output,
        }

    def _decoded(self, register: Register, words: Mapping[int, int]) -> float:
        number = self._code.number(register, words)
        if register.bit is not None:
            number = float(int(number) >> register.bit & 1)
        return register.gain * number + register.bias
