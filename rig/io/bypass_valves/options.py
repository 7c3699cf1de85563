"""The options of the bypass valves in a rig file."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from rig.channels import BYPASSES
from rig.plant import Quantity as _Quantity

from .registers import STANDARD_REGISTERS, BypassRegisters

_CYCLE_CHARACTERS: Final = 38 + 4 * 3.5
"""Time that one `read` takes on an RTU line, in characters: two requests and two replies, each
followed by a silence of 3.5 characters."""
_BITS_PER_CHARACTER: Final = 11
"""Start, 8 data bits, parity or stop, stop (Modbus over serial line V1.02, section 2.5.1)."""


def _q(unit: str, lower: float, upper: float, source: str = "") -> _Quantity:
    return _Quantity(unit, lower, upper, "", source)


@dataclass(frozen=True)
class BypassOptions:
    """Keys of the bypass valves in a rig file.

    Attributes:
        transport: `tcp` (Modbus/TCP) or `rtu` (on a serial line).
        host: address of the device, with `tcp`.
        port: port of the device, with `tcp`.
        device: serial port, with `rtu`; only one process at a time can use it.
        baud: baud rate of the serial line, with `rtu`.
        parity: parity of the serial line, with `rtu`; it has 8 data bits and 1 stop bit.
        unit: Modbus unit identifier.
        rate: how often the valves are read.
        timeout: how long a reply may take.
        watchdog: time without a request after which the device itself shuts the valves; 0 switches
            that off.
        bypasses: the bypasses that the rig has.
        blocking: whether the device drives a blocking valve in the line of each chamber, too.
        ball_travel: time that a ball takes from shut to open.
        needle_travel: time that a needle takes over its whole range.
        margin: time beyond the travel after which a move has failed.
        needle_tolerance: greatest distance from its setpoint at which a needle counts as arrived.
        map: addresses of the device's registers, given here or in a file of `config/maps`.
    """

    transport: Literal["tcp", "rtu"] = "tcp"
    host: str = ""
    port: Annotated[int, _q("", 1, 0xFFFF)] = 502
    device: str = ""
    baud: Annotated[int, _q("", 1200, 1_000_000)] = 19_200
    parity: Literal["even", "odd", "none"] = "even"
    unit: Annotated[int, _q("", 1, 247, "Modbus over serial line V1.02, section 2.2")] = 1
    rate: Annotated[float, _q("Hz", 1.0, 50.0)] = 20.0
    timeout: Annotated[float, _q("s", 0.01, 2.0)] = 0.2
    watchdog: Annotated[float, _q("s", 0.0, 60.0)] = 1.0
    bypasses: tuple[str, ...] = BYPASSES
    blocking: bool = False
    ball_travel: Annotated[float, _q("s", 0.0, 60.0)] = 0.5
    needle_travel: Annotated[float, _q("s", 0.0, 60.0)] = 2.0
    margin: Annotated[float, _q("s", 0.1, 60.0)] = 1.0
    needle_tolerance: Annotated[float, _q("", 1e-4, 0.2)] = 0.02
    map: BypassRegisters = STANDARD_REGISTERS

    def problems(self) -> Iterator[str]:
        """Yield a sentence for each option that is missing, wrong, or does not fit the others."""
        if self.transport == "tcp" and not self.host:
            yield "`host` is missing, which `transport: tcp` needs"
        if self.transport == "rtu" and not self.device:
            yield "`device` is missing, which `transport: rtu` needs"
        unknown = [bypass for bypass in self.bypasses if bypass not in BYPASSES]
        if unknown or not self.bypasses or len(set(self.bypasses)) < len(self.bypasses):
            given = ", ".join(self.bypasses) or "nothing"
            yield f"`bypasses` is {given}, not some of {', '.join(BYPASSES)}, each once"
        if 0.0 < self.watchdog < 2.0 / self.rate:
            yield (
                f"`watchdog` {self.watchdog:g} s would strike between two readings at "
                f"{self.rate:g} Hz; give it {2.0 / self.rate:g} s or more"
            )
        fastest = self.baud / (_BITS_PER_CHARACTER * _CYCLE_CHARACTERS)
        if self.transport == "rtu" and self.rate > fastest:
            yield f"`rate` {self.rate:g} Hz is above {fastest:.3g} Hz, what {self.baud} baud pass"
