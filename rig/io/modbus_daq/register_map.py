"""What a Modbus device holds at which address: the map its driver works by.

A shipped map (config/maps) is this dataclass as YAML, field by field; a device that has no register
for a signal leaves the signal out, and it reads NaN.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated, Literal

from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.plant import Quantity

from .register_rules import FEEDBACK_BYTES, MapProblem, RegisterMapError, problems
from .registers import (
    WORDS,
    ExchangeMode,
    Fact,
    Register,
    RegisterType,
    RegisterValue,
    Span,
    Watchdog,
    block,
    feedback_bytes,
    spans,
)

# All that who works by a map needs of it.
__all__ = [
    "FEEDBACK_BYTES",
    "WORDS",
    "ExchangeMode",
    "Fact",
    "MapProblem",
    "Register",
    "RegisterMap",
    "RegisterMapError",
    "RegisterType",
    "RegisterValue",
    "Span",
    "Watchdog",
    "block",
    "feedback_bytes",
    "spans",
]


@dataclass(frozen=True)
class RegisterMap:
    """A device's registers, and what else its driver must know of it.

    Attributes:
        device: what to call it in messages.
        exchange: the ways in which it can exchange outputs and inputs, the best first.
        rate: exchanges it can do in a second, Hz.
        registers: its signals.
        identity: register and value by which it is known.
        version: the same for the version of its map, if it has one.
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
        broken = problems(self)
        if broken:
            raise RegisterMapError(broken)

    @property
    def read(self) -> tuple[Register, ...]:
        """Return the registers read in an exchange, by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_INPUTS)

    @property
    def written(self) -> tuple[Register, ...]:
        """Return the registers written in an exchange, by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_OUTPUTS)


def _ordered(registers: Iterable[Register]) -> tuple[Register, ...]:
    return tuple(sorted(registers, key=lambda register: (register.address, register.bit or 0)))
