"""The register map of a Modbus device, which gives its driver the address of each signal.

A shipped map (config/maps) is this dataclass written as YAML, field by field. If a device has no
register for a signal, its map leaves the signal out, and the signal reads NaN.
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

# These are all the names that a user of register maps needs.
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
    facts: tuple[Fact, ...] = ()

    def __post_init__(self) -> None:
        broken = problems(self)
        if broken:
            raise RegisterMapError(broken)

    @property
    def read(self) -> tuple[Register, ...]:
        """Return the registers that are read in an exchange, ordered by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_INPUTS)

    @property
    def written(self) -> tuple[Register, ...]:
        """Return the registers that are written in an exchange, ordered by address."""
        return _ordered(register for register in self.registers if register.signal in FAST_OUTPUTS)


def _ordered(registers: Iterable[Register]) -> tuple[Register, ...]:
    return tuple(sorted(registers, key=lambda register: (register.address, register.bit or 0)))
