"""The parts of a register map: registers, the meaning of their numbers, and runs of addresses."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple

from rig.plant import LITRE_PER_MINUTE, Quantity

RegisterType = Literal["U16", "I16", "U32", "I32", "F32"]
ExchangeMode = Literal["fc23", "fc76", "fc16_fc3"]

WORDS: Final = {"U16": 1, "I16": 1, "U32": 2, "I32": 2, "F32": 2}
"""Number of 16-bit registers that a value of each type takes."""

UNITS: Final = {
    "": ("", 1.0),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "bar": ("Pa", 1e5),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "K": ("K", 1.0),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "m^3/s": ("m3_per_s", 1.0),
    "L/min": ("m3_per_s", LITRE_PER_MINUTE),
}
"""Units that a register may have, with the ending of the signals they fit and their size in SI."""

_SHORTEST, _LONGEST = 1e-3, 3600.0


class Span(NamedTuple):
    """A run of `size` registers, one after the other, from `address` on."""

    address: int
    size: int


@dataclass(frozen=True)
class RegisterValue:
    """A register, with the number that it must hold or that is written into it."""

    address: int
    type: RegisterType
    value: float


@dataclass(frozen=True)
class Fact:
    """A register that describes the device; diagnostics show its number without scaling."""

    name: str
    address: int
    type: RegisterType


@dataclass(frozen=True)
class Register:
    """The register of one signal, whose value is `scale * number + offset` in `unit`.

    Attributes:
        signal: name of the signal in `rig.io.signals`.
        address: address of the signal's first register, counted from 0.
        type: how the number is coded.
        access: "r" if it is read in the exchange, "w" if it is written in it, "rw" if it is written
            in it and can be read back.
        bit: bit of a switch in a U16 register, 0 being the lowest; None for a number.
        scale: value of one count, in `unit`; -1 with offset 1 inverts a switch.
        offset: value at number 0, in `unit`.
        unit: one of `UNITS`; empty for counters and switches.
    """

    signal: str
    address: int
    type: RegisterType
    access: Literal["r", "w", "rw"]
    bit: int | None = None
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""

    @property
    def gain(self) -> float:
        """Return the SI value of one count."""
        return self.scale * UNITS[self.unit][1]

    @property
    def bias(self) -> float:
        """Return the SI value at number 0."""
        return self.offset * UNITS[self.unit][1]


@dataclass(frozen=True)
class Watchdog:
    """The registers by which the device's own watchdog is set and armed.

    Attributes:
        address: address of the register of the watchdog's time.
        type: type of that register.
        counts_per_s: number that the register holds for one second.
        shortest: shortest time that the watchdog can have, s.
        longest: longest time that it may have, s.
        arm: values that are written after the time, in order, to arm the watchdog.
    """

    address: int
    type: RegisterType
    counts_per_s: float
    shortest: Annotated[float, Quantity("s", _SHORTEST, _LONGEST, "", "device's data sheet")]
    longest: Annotated[float, Quantity("s", _SHORTEST, _LONGEST, "", "device's data sheet")]
    arm: tuple[RegisterValue, ...] = ()


def spans(registers: Sequence[Register]) -> tuple[Span, ...]:
    """Return the runs without gaps that registers make, which are given ordered by address."""
    found: list[Span] = []
    for register in registers:
        end = register.address + WORDS[register.type]
        if found and register.address <= (last := found[-1]).address + last.size:
            found[-1] = Span(last.address, max(end - last.address, last.size))
        else:
            found.append(Span(register.address, end - register.address))
    return tuple(found)


def block(registers: Sequence[Register]) -> Span:
    """Return the run of addresses from the first to the last register, with the gaps between.

    There is at least one register, and they are given ordered by address.
    """
    runs = spans(registers)
    return Span(runs[0].address, runs[-1].address + runs[-1].size - runs[0].address)


def feedback_bytes(read: Sequence[Span], written: Sequence[Span]) -> tuple[int, int]:
    """Return the bytes of a feedback request (function 76) for these runs, and of its reply."""
    header = 8
    words_out = sum(span.size for span in written)
    words_in = sum(span.size for span in read)
    return header + 4 * (len(read) + len(written)) + 2 * words_out, header + 2 * words_in
