"""What a Modbus device holds at which address: the map its driver works by, and the map's rules.

A shipped map (config/maps) is this dataclass as YAML, field by field; a device that has no register
for a signal leaves the signal out, and it reads NaN.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Final, Literal, NamedTuple

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.plant.parameters import LITRE_PER_MINUTE, Quantity

RegisterType = Literal["U16", "I16", "U32", "I32", "F32"]
ExchangeMode = Literal["fc23", "fc76", "fc16_fc3"]

WORDS: Final = {"U16": 1, "I16": 1, "U32": 2, "I32": 2, "F32": 2}
"""Registers of 16 bits that a value of each type takes."""

READ_REGISTERS: Final = 125
"""Most registers one request reads (Modbus Application Protocol V1.1b3, 6.3 and 6.17)."""

WRITE_REGISTERS: Final = {"fc23": 121, "fc16_fc3": 123}
"""Most registers one request writes, by exchange mode (same, 6.17 and 6.12)."""

FEEDBACK_BYTES: Final = 1040
"""Longest packet of LabJack's feedback function over Ethernet (its "Protocol Details")."""

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
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "m^3/s": ("m3_per_s", 1.0),
    "L/min": ("m3_per_s", LITRE_PER_MINUTE),
}
"""Units that a register may have: the ending of the signals that it fits, and its value in SI."""

_LAST_ADDRESS: Final = 0xFFFF
_SHORTEST, _LONGEST = 1e-3, 3600.0


class MapProblem(NamedTuple):
    """One thing that a map cannot have."""

    path: tuple[str | int, ...]
    """Field by field and index by index, where it stands in the map."""
    value: object
    limit: str
    """What the value breaks, as the end of a sentence."""
    remedy: str

    def __str__(self) -> str:
        where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.path)
        return f"{where.lstrip('.')}: {self.value} {self.limit}; {self.remedy}"


class RegisterMapError(ValueError):
    """Everything wrong with one map, one line a problem.

    Attributes:
        problems: the problems, never empty.
    """

    def __init__(self, problems: Sequence[MapProblem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[type["RegisterMapError"], tuple[tuple[MapProblem, ...]]]:
        return type(self), (self.problems,)


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
    """A register that tells something of the device; read for diagnostics, as it stands."""

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


@dataclass(frozen=True)
class RegisterMap:
    """A device's registers, and what else its driver must know of it.

    Attributes:
        device: what to call it in messages.
        exchange: the ways in which it can exchange outputs and inputs, the best first.
        rate: exchanges it can do in a second, Hz.
        registers: its signals.
        identity: register and value by which it is known.
        version: the same for the version of its map, if it tells one.
        word_order: of 32-bit values.
        setup: written at the start, in order, unless the device has the last value of each already
            (some keep them in flash, which wears).
        watchdog: its watchdog, if it has one.
        null_request: writing this brings its valve output to 0 and the valve off; reads back so.
        facts: read for diagnostics; "greatest_rate_Hz", if there is one, further limits `rate`.

    Raises:
        RegisterMapError: every rule that the values break.
    """

    device: str
    exchange: tuple[ExchangeMode, ...]
    rate: Annotated[float, Quantity("Hz", 0.1, 1e4, "", "device's data sheet, or measured")]
    registers: tuple[Register, ...]
    identity: RegisterValue
    version: RegisterValue | None = None
    word_order: Literal["high_first", "low_first"] = "high_first"
    setup: tuple[RegisterValue, ...] = ()
    watchdog: Watchdog | None = None
    null_request: RegisterValue | None = None
    facts: tuple[Fact, ...] = ()

    def __post_init__(self) -> None:
        problems = [*_register_problems(self.registers), *_other_problems(self)]
        # Blocks of registers that are wrong themselves would only repeat it.
        problems = problems or [*_block_problems(self)]
        if problems:
            raise RegisterMapError(problems)

    @property
    def read(self) -> tuple[Register, ...]:
        """Return the registers read in an exchange, by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_INPUTS)

    @property
    def written(self) -> tuple[Register, ...]:
        """Return the registers written in an exchange, by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_OUTPUTS)


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


def _ordered(registers: Iterable[Register]) -> tuple[Register, ...]:
    return tuple(sorted(registers, key=lambda register: (register.address, register.bit or 0)))


def _si_ending(signal: str) -> str:
    """Return the unit that ends a signal's name; none for counters and switches."""
    endings = {ending for ending, _ in UNITS.values() if ending}
    return next((ending for ending in endings if signal.endswith(f"_{ending}")), "")


def _register_problems(registers: Sequence[Register]) -> Iterator[MapProblem]:
    seen: set[str] = set()
    for index, register in enumerate(registers):
        at: tuple[str | int, ...] = ("registers", index)
        signal = register.signal
        if signal not in (*FAST_INPUTS, *FAST_OUTPUTS):
            names = ", ".join((*FAST_INPUTS, *FAST_OUTPUTS))
            yield MapProblem((*at, "signal"), signal, "is no signal", f"one of {names}")
            continue
        if signal in seen:
            yield MapProblem((*at, "signal"), signal, "has a register already", "remove one")
        seen.add(signal)
        needed = "r" if signal in FAST_INPUTS else "w"
        if needed not in register.access:
            limit = f"does not fit {signal}, which is {'read' if needed == 'r' else 'written'}"
            yield MapProblem((*at, "access"), register.access, limit, f"write {needed}")
        yield from _address_problems(at, register.address, register.type)
        if register.bit is not None and (register.type != "U16" or not 0 <= register.bit < 16):
            limit = f"is no bit of a {register.type} register"
            yield MapProblem((*at, "bit"), register.bit, limit, "bits are 0 to 15, of U16")
        if not math.isfinite(register.scale) or register.scale == 0.0:
            yield MapProblem((*at, "scale"), register.scale, "scales nothing", "write a number")
        if not math.isfinite(register.offset):
            yield MapProblem((*at, "offset"), register.offset, "is no number", "write a number")
        ending = _si_ending(signal)
        fitting = [unit for unit, (fits, _) in UNITS.items() if fits == ending]
        if register.unit not in fitting:
            remedy = f"one of {', '.join(fitting)}" if ending else "leave it out"
            yield MapProblem((*at, "unit"), register.unit, f"is no unit of {signal}", remedy)
    if "command_V" not in seen:
        yield MapProblem(("registers",), "command_V", "has no register", "add where it is written")
    if seen.isdisjoint(FAST_INPUTS):
        yield MapProblem(("registers",), "none", "is read", "add the device's inputs")


def _address_problems(
    path: tuple[str | int, ...], address: int, kind: RegisterType
) -> Iterator[MapProblem]:
    last = _LAST_ADDRESS + 1 - WORDS[kind]
    if not 0 <= address <= last:
        limit = f"is no address of a {kind} register"
        yield MapProblem((*path, "address"), address, limit, f"addresses are 0 to {last}")


def _other_problems(given: RegisterMap) -> Iterator[MapProblem]:
    if not given.exchange:
        yield MapProblem(("exchange",), "none", "is no way to exchange", "name one at least")
    if not given.rate > 0.0:
        yield MapProblem(("rate",), given.rate, "is not above 0", "write the device's rate in Hz")
    places: list[tuple[tuple[str | int, ...], RegisterValue | Fact | Watchdog | None]] = [
        (("identity",), given.identity),
        (("version",), given.version),
        (("null_request",), given.null_request),
        (("watchdog",), given.watchdog),
        *((("setup", index), value) for index, value in enumerate(given.setup)),
        *((("facts", index), fact) for index, fact in enumerate(given.facts)),
    ]
    if given.watchdog is not None:
        watchdog = given.watchdog
        arm = enumerate(watchdog.arm)
        places.extend((("watchdog", "arm", index), value) for index, value in arm)
        if not 0.0 < watchdog.shortest <= watchdog.longest:
            limit = f"is not from 0 to the longest, {watchdog.longest:g} s"
            yield MapProblem(("watchdog", "shortest"), watchdog.shortest, limit, "mend either")
        if not watchdog.counts_per_s > 0.0:
            yield MapProblem(
                ("watchdog", "counts_per_s"), watchdog.counts_per_s, "is not above 0", "1000 for ms"
            )
    for path, place in places:
        if place is not None:
            yield from _address_problems(path, place.address, place.type)


def _block_problems(given: RegisterMap) -> Iterator[MapProblem]:
    for registers in (given.read, given.written):
        for first, second in pairwise(registers):
            bits = first.bit is not None and second.bit is not None and first.bit != second.bit
            if bits and first.address == second.address:
                continue
            if second.address < first.address + WORDS[first.type]:
                index = given.registers.index(second)
                limit = f"of {second.signal} overlaps {first.signal} at {first.address}"
                remedy = "give each its own registers"
                yield MapProblem(("registers", index, "address"), second.address, limit, remedy)
    read, written = block(given.read), block(given.written)
    for index, mode in enumerate(given.exchange):
        where = ("exchange", index)
        if mode == "fc76":
            longest = max(feedback_bytes(spans(given.read), spans(given.written)))
            if longest > FEEDBACK_BYTES:
                limit = f"needs a packet of {longest} bytes, above {FEEDBACK_BYTES}"
                yield MapProblem(where, mode, limit, "leave signals out")
            continue
        if read.size > READ_REGISTERS:
            limit = f"needs {read.size} registers from {read.address}, above {READ_REGISTERS}"
            yield MapProblem(where, mode, limit, "leave signals out, or use fc76")
        if written.size > WRITE_REGISTERS[mode]:
            limit = f"writes {written.size} registers, above {WRITE_REGISTERS[mode]}"
            yield MapProblem(where, mode, limit, "leave signals out, or use fc76")
        if len(spans(given.written)) > 1:
            limit = f"would write 0 into the gaps from {written.address} on"
            yield MapProblem(
                where, mode, limit, "written registers must be in one run, or use fc76"
            )


def feedback_bytes(read: Sequence[Span], written: Sequence[Span]) -> tuple[int, int]:
    """Return the lengths of a feedback request (function 76) and of its reply."""
    header = 8
    words_out = sum(span.size for span in written)
    words_in = sum(span.size for span in read)
    return header + 4 * (len(read) + len(written)) + 2 * words_out, header + 2 * words_in
