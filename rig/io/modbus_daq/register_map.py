"""The register map of a Modbus device, which gives its driver the address of each signal.

A shipped map (config/maps) is the dataclass `RegisterMap` written as YAML, field by field. If a
device has no register for a signal, its map leaves the signal out, and the signal reads NaN. All
rules that a map breaks are reported at once.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Annotated, Final, Literal, NamedTuple

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.plant import GALLON_PER_MINUTE, LITRE_PER_MINUTE, PSI, Quantity

RegisterType = Literal["U16", "I16", "U32", "I32", "F32"]
ExchangeMode = Literal["fc23", "fc76", "fc16_fc3"]

WORDS: Final = {"U16": 1, "I16": 1, "U32": 2, "I32": 2, "F32": 2}
"""Number of 16-bit registers that a value of each type takes."""

UNITS: Final = {
    "": ("", 1.0),
    "m": ("m", 1.0),
    "mm": ("m", 1e-3),
    "um": ("m", 1e-6),
    "in": ("m", 0.0254),
    "Pa": ("Pa", 1.0),
    "kPa": ("Pa", 1e3),
    "MPa": ("Pa", 1e6),
    "bar": ("Pa", 1e5),
    "psi": ("Pa", PSI),
    "N": ("N", 1.0),
    "kN": ("N", 1e3),
    "K": ("K", 1.0),
    "V": ("V", 1.0),
    "mV": ("V", 1e-3),
    "m^3/s": ("m3_per_s", 1.0),
    "L/min": ("m3_per_s", LITRE_PER_MINUTE),
    "gpm": ("m3_per_s", GALLON_PER_MINUTE),
}
"""Units that a register may have, with the ending of the signals they fit and their size in SI."""

READ_REGISTERS: Final = 125
"""Greatest number of registers that one request reads.

Source: Modbus Application Protocol V1.1b3, sections 6.3 and 6.17.
"""

WRITE_REGISTERS: Final = {"fc23": 121, "fc16_fc3": 123}
"""Greatest number of registers that one request writes, by exchange mode.

Source: Modbus Application Protocol V1.1b3, sections 6.17 and 6.12.
"""

FEEDBACK_BYTES: Final = 1040
"""Bytes of the longest packet of LabJack's feedback function by Ethernet ("Protocol Details")."""

_LAST_ADDRESS: Final = 0xFFFF
_SIGNALS: Final = (*FAST_INPUTS, *FAST_OUTPUTS)


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


@dataclass(frozen=True)
class Ownership:
    """The registers, all U16, by which one master owns a device (docs/io_node.md, "Ownership").

    Attributes:
        claim: address of the register into which a master writes its key to own the device.
        release: address of the register into which it writes its key to give the device up.
        heartbeat: address of the register that is written in the exchange: the key and its
            complement in turn. It continues the run of the registers of outputs.
        told: address of a register that is read in the exchange: bit 15 is set while somebody owns
            the device, and the others count what others wrote and the device refused.
    """

    claim: int
    release: int
    heartbeat: int
    told: int


class MapProblem(NamedTuple):
    """One rule that a register map breaks, with the value that breaks it and a remedy."""

    path: tuple[str | int, ...]
    """Place of the value in the map, as names of fields and indices from the outside in."""
    value: object
    """The value that breaks the rule."""
    limit: str
    """What is wrong with the value, as the end of a sentence that begins with the value."""
    remedy: str
    """What to write instead."""

    def __str__(self) -> str:
        where = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in self.path)
        return f"{where.lstrip('.')}: {self.value} {self.limit}; {self.remedy}"


class RegisterMapError(ValueError):
    """Raised with everything that is wrong with one map, one line for each problem.

    Attributes:
        problems: the problems, never empty.
    """

    def __init__(self, problems: Sequence[MapProblem]) -> None:
        super().__init__("\n".join(str(problem) for problem in problems))
        self.problems = tuple(problems)

    def __reduce__(self) -> tuple[type["RegisterMapError"], tuple[tuple[MapProblem, ...]]]:
        return type(self), (self.problems,)


@dataclass(frozen=True)
class RegisterMap:
    """The registers of a device, and the other properties that its driver must know.

    Attributes:
        device: name of the device in messages.
        exchange: the ways in which the device can exchange outputs and inputs, the best first.
        rate: greatest number of exchanges in a second, Hz.
        registers: the registers of the device's signals.
        identity: register and value by which the device is recognised.
        version: register and value by which the version of its map is recognised, if it has one.
        word_order: order of the two words of a 32-bit value.
        setup: values that are written at the start, in order, unless the device holds the last
            value of each register already (some devices keep them in flash memory, which wears).
        watchdog: the device's watchdog, if it has one.
        null_request: value whose writing brings the valve output to 0 V and switches the valve off;
            its register then reads back that value.
        owner: the registers by which one master owns the device, if it has them.
        echo: "exact" if `device_echo` in a reply is the `host_counter` of its own request, so that
            a reply of an earlier exchange is known by it; "lagging" if it may be an earlier one.
        facts: registers that are read for diagnostics; "greatest_rate_Hz", if there is one,
            limits `rate` further.

    Raises:
        RegisterMapError: the values break rules; the error names all of them.
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
    owner: Ownership | None = None
    echo: Literal["exact", "lagging"] = "lagging"
    facts: tuple[Fact, ...] = ()

    def __post_init__(self) -> None:
        broken = [*_register_problems(self.registers), *_other_problems(self)]
        # If single registers are wrong, the rules for blocks of them would only repeat that.
        broken = broken or [*_block_problems(self)]
        if broken:
            raise RegisterMapError(broken)

    @property
    def read(self) -> tuple[Register, ...]:
        """Return the registers that are read in an exchange, ordered by address."""
        return self._of(FAST_INPUTS)

    @property
    def written(self) -> tuple[Register, ...]:
        """Return the registers that are written in an exchange, ordered by address."""
        return self._of(FAST_OUTPUTS)

    def exchanged(self, *, owned: bool) -> tuple[tuple[Register, ...], tuple[Register, ...]]:
        """Return the registers that an exchange reads and those that it writes, by address.

        With `owned` the registers of ownership are among them, under names of their own.
        """
        read, written = [*self.read], [*self.written]
        if owned and self.owner is not None:
            read.append(Register("owner_told", self.owner.told, "U16", "r"))
            written.append(Register("owner_heartbeat", self.owner.heartbeat, "U16", "w"))
        return _by_address(read), _by_address(written)

    def _of(self, signals: Sequence[str]) -> tuple[Register, ...]:
        found = [register for register in self.registers if register.signal in signals]
        return _by_address(found)


def _by_address(registers: Sequence[Register]) -> tuple[Register, ...]:
    return tuple(sorted(registers, key=lambda register: (register.address, register.bit or 0)))


def spans(registers: Sequence[Register]) -> tuple[Span, ...]:
    """Return the runs without gaps that registers make; the registers are ordered by address."""
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
    """Return the numbers of bytes of a feedback request (function 76) for runs and of its reply."""
    header = 8
    words_out = sum(span.size for span in written)
    words_in = sum(span.size for span in read)
    return header + 4 * (len(read) + len(written)) + 2 * words_out, header + 2 * words_in


def _register_problems(registers: Sequence[Register]) -> Iterator[MapProblem]:
    endings = {ending for ending, _ in UNITS.values() if ending}
    seen: set[str] = set()
    for index, register in enumerate(registers):
        at: tuple[str | int, ...] = ("registers", index)
        signal, kind = register.signal, register.type
        if signal not in _SIGNALS:
            names = ", ".join(_SIGNALS)
            yield MapProblem((*at, "signal"), signal, "is no signal", f"one of {names}")
            continue
        needed, way = ("r", "read") if signal in FAST_INPUTS else ("w", "written")
        misfit = f"does not fit {signal}, which is {way}"
        is_bit = register.bit is None or (kind == "U16" and 0 <= register.bit < 16)
        scales = math.isfinite(register.scale) and register.scale != 0.0
        ending = next((ending for ending in endings if signal.endswith(f"_{ending}")), "")
        fitting = [unit for unit, (fits, _) in UNITS.items() if fits == ending]
        units = f"one of {', '.join(fitting)}" if ending else "leave it out"
        for field, kept, limit, remedy in (
            ("signal", signal not in seen, "has a register already", "remove one"),
            ("access", needed in register.access, misfit, f"write {needed}"),
            ("address", *_address_rule(register)),
            ("bit", is_bit, f"is no bit of a {kind} register", "bits are 0 to 15, of U16"),
            ("scale", scales, "scales nothing", "write a number"),
            ("offset", math.isfinite(register.offset), "is no number", "write a number"),
            ("unit", register.unit in fitting, f"is no unit of {signal}", units),
        ):
            if not kept:
                yield MapProblem((*at, field), getattr(register, field), limit, remedy)
        seen.add(signal)
    if "command_V" not in seen:
        yield MapProblem(("registers",), "command_V", "has no register", "add where it is written")
    if seen.isdisjoint(FAST_INPUTS):
        yield MapProblem(("registers",), "none", "is read", "add the device's inputs")


def _address_rule(place: Register | RegisterValue | Fact | Watchdog) -> tuple[bool, str, str]:
    """Return whether the address fits the type, what is wrong if it does not, and a remedy."""
    last = _LAST_ADDRESS + 1 - WORDS[place.type]
    limit = f"is no address of a {place.type} register"
    return 0 <= place.address <= last, limit, f"addresses are 0 to {last}"


def _other_problems(given: RegisterMap) -> Iterator[MapProblem]:
    if not given.exchange:
        yield MapProblem(("exchange",), "none", "is no way to exchange", "name one at least")
    if not given.rate > 0.0:
        yield MapProblem(("rate",), given.rate, "is not above 0", "write the device's rate in Hz")
    places: dict[tuple[str | int, ...], RegisterValue | Fact | Watchdog | None] = {
        ("identity",): given.identity,
        ("version",): given.version,
        ("null_request",): given.null_request,
        ("watchdog",): given.watchdog,
        **{("setup", index): value for index, value in enumerate(given.setup)},
        **{("facts", index): fact for index, fact in enumerate(given.facts)},
    }
    if given.owner is not None:
        owner = asdict(given.owner)
        places |= {("owner", name): Fact(name, at, "U16") for name, at in owner.items()}
    if given.watchdog is not None:
        shortest, longest = given.watchdog.shortest, given.watchdog.longest
        counts = given.watchdog.counts_per_s
        places |= {("watchdog", "arm", i): value for i, value in enumerate(given.watchdog.arm)}
        if not 0.0 < shortest <= longest:
            limit = f"is not from 0 to the longest, {longest:g} s"
            yield MapProblem(("watchdog", "shortest"), shortest, limit, "mend either")
        if not counts > 0.0:
            where = ("watchdog", "counts_per_s")
            yield MapProblem(where, counts, "is not above 0", "1000 for ms")
    for path, place in places.items():
        if place is not None:
            kept, limit, remedy = _address_rule(place)
            if not kept:
                field = () if path[0] == "owner" else ("address",)
                yield MapProblem((*path, *field), place.address, limit, remedy)


def _block_problems(given: RegisterMap) -> Iterator[MapProblem]:
    exchanged = given.exchanged(owned=True)
    for first, second in (*pairwise(exchanged[0]), *pairwise(exchanged[1])):
        bits = None not in (first.bit, second.bit) and first.bit != second.bit
        if bits and first.address == second.address:
            continue
        if second.address < first.address + WORDS[first.type]:
            path = _path_of(given, second)
            limit = f"of {second.signal} overlaps {first.signal} at {first.address}"
            yield MapProblem(path, second.address, limit, "give each its own registers")
    runs_in, runs_out = (spans(registers) for registers in exchanged)
    read, written = (block(registers) for registers in exchanged)
    longest = max(feedback_bytes(runs_in, runs_out))
    others = "leave signals out, or use fc76"
    for index, mode in enumerate(given.exchange):
        if mode == "fc76":
            needs = f"needs a packet of {longest} bytes, above {FEEDBACK_BYTES}"
            rules = [(longest <= FEEDBACK_BYTES, needs, "leave signals out")]
        else:
            needs = f"needs {read.size} registers from {read.address}, above {READ_REGISTERS}"
            writes = f"writes {written.size} registers, above {WRITE_REGISTERS[mode]}"
            gaps = f"would write 0 into the gaps from {written.address} on"
            one_run = "written registers must be in one run, or use fc76"
            rules = [
                (read.size <= READ_REGISTERS, needs, others),
                (written.size <= WRITE_REGISTERS[mode], writes, others),
                (len(runs_out) == 1, gaps, one_run),
            ]
        for kept, limit, remedy in rules:
            if not kept:
                yield MapProblem(("exchange", index), mode, limit, remedy)


def _path_of(given: RegisterMap, register: Register) -> tuple[str | int, ...]:
    if register in given.registers:
        return "registers", given.registers.index(register), "address"
    return "owner", register.signal.removeprefix("owner_")
