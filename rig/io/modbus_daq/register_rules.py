"""The rules that a register map must keep; all broken rules are reported at once."""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS

from .registers import (
    UNITS,
    WORDS,
    Fact,
    Register,
    RegisterType,
    RegisterValue,
    Watchdog,
    block,
    feedback_bytes,
    spans,
)

if TYPE_CHECKING:
    from .register_map import RegisterMap

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


def problems(given: "RegisterMap") -> list[MapProblem]:
    """Return the rules that a map breaks; empty if it breaks none.

    The rules for blocks of registers are checked only if the map breaks no other rule.
    """
    found = [*_register_problems(given.registers), *_other_problems(given)]
    # If single registers are wrong, the rules for blocks of them would only repeat that.
    return found or [*_block_problems(given)]


def _si_ending(signal: str) -> str:
    """Return the unit that ends a signal's name; empty for counters and switches."""
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


def _other_problems(given: "RegisterMap") -> Iterator[MapProblem]:
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


def _block_problems(given: "RegisterMap") -> Iterator[MapProblem]:
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
