"""The pieces of a register map: registers, what their numbers mean, and the runs they stand in."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Final, Literal, NamedTuple

from rig.plant import LITRE_PER_MINUTE, Quantity

RegisterType = Literal["U16", "I16", "U32", "I32", "F32"]
ExchangeMode = Literal["fc23", "fc76", "fc16_fc3"]

WORDS: Final = {"U16": 1, "I16": 1, "U32": 2, "I32": 2, "F32": 2}
"""Registers of 16 bits that a value of each type takes."""

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
"""Units that a register may have: the ending of the signals that it fits, and its value in SI."""

_SHORTEST, _LONGEST = 1e-3, 3600.0


class Span(NamedTuple):
    """Registers one after the other."""

    address: int
    size: int


@dataclass(frozen=True)
class RegisterValue:
    """A register, with the value that it has or shall get."""

    address: int
    type: RegisterType
    value: float


@dataclass(frozen=True)
class Fact:
    """A register that says something about the device; read for diagnostics, as it stands."""

    name: str
    address: int
    type: RegisterType


@dataclass(frozen=True)
class Register:
    """Where a signal is, and what its number means: `(scale * number + offset)` in `unit`.

    Attributes:
        signal: its name in `rig.io.signals`.
        address: its first register, from 0.
        type: how the number is coded.
        access: "r" read in the exchange, "w" written in it, "rw" written and can be read back.
        bit: for a switch in a U16 word, its bit, 0 the lowest.
        scale: of one count, in `unit`; -1 with offset 1 inverts a switch.
        offset: at number 0, in `unit`.
        unit: one of `UNITS`; none for counters and switches.
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
    """The device's own watchdog: where its time is set, and what arms it after that.

    Attributes:
        address: register of its time.
        type: of that register.
        counts_per_s: what the register holds for one second.
        shortest: shortest time it can do, s.
        longest: longest time it may have, s.
        arm: written after the time, in order.
    """

    address: int
    type: RegisterType
    counts_per_s: float
    shortest: Annotated[float, Quantity("s", _SHORTEST, _LONGEST, "", "device's data sheet")]
    longest: Annotated[float, Quantity("s", _SHORTEST, _LONGEST, "", "device's data sheet")]
    arm: tuple[RegisterValue, ...] = ()


def spans(registers: Sequence[Register]) -> tuple[Span, ...]:
    """Return the runs without gap that registers, ordered by address, stand in."""
    found: list[Span] = []
    for register in registers:
        end = register.address + WORDS[register.type]
        if found and register.address <= (last := found[-1]).address + last.size:
            found[-1] = Span(last.address, max(end - last.address, last.size))
        else:
            found.append(Span(register.address, end - register.address))
    return tuple(found)


def block(registers: Sequence[Register]) -> Span:
    """Return the one run, gaps included, that registers, ordered by address, stand in."""
    runs = spans(registers)
    return Span(runs[0].address, runs[-1].address + runs[-1].size - runs[0].address)


def feedback_bytes(read: Sequence[Span], written: Sequence[Span]) -> tuple[int, int]:
    """Return the lengths of a feedback request (function 76) and of its reply."""
    header = 8
    words_out = sum(span.size for span in written)
    words_in = sum(span.size for span in read)
    return header + 4 * (len(read) + len(written)) + 2 * words_out, header + 2 * words_in
