"""The faults that can be injected on the emulated rig, in wires, sensors, valves and devices."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import Annotated, Any, Final, Literal

from rig.emulator.instruments import Channel, Failure
from rig.plant import FaultName, Quantity as _Quantity

ModbusDevice = Literal["daq", "bypass"]
CanDevice = Literal["drive", "pump"]
Start = Literal["start", "enable"]


def _q(unit: str, lower: float, upper: float) -> _Quantity:
    return _Quantity(unit, lower, upper, "", "")


@dataclass(frozen=True)
class _OfWire:
    """A fault of the wire to a Modbus device."""

    target: ModbusDevice = "daq"


@dataclass(frozen=True)
class Delay(_OfWire):
    """Replies come late by the time `by`, s."""

    by: Annotated[float, _q("s", 1e-4, 60.0)] = 5e-3


@dataclass(frozen=True)
class Drop(_OfWire):
    """Replies or requests are lost, as `what` says."""

    what: Literal["replies", "requests"] = "replies"


class Garbage(_OfWire):
    """Replies are random bytes of the right length."""


class WrongTransaction(_OfWire):
    """Replies have the number of another transaction."""


@dataclass(frozen=True)
class Refusal(_OfWire):
    """The device answers every request with an exception, and does nothing.

    Attributes:
        code: code of the Modbus exception.
    """

    code: Annotated[int, _q("", 1, 11)] = 4


class Disconnect(_OfWire):
    """Every connection breaks, and new ones are refused while the fault lasts."""


@dataclass(frozen=True)
class Frozen:
    """A channel keeps its reading; with `daq` the whole I/O device repeats its last sample."""

    target: Channel | Literal["daq"] = "daq"


@dataclass(frozen=True)
class Sensor:
    """A transducer fails: it reads not a number, zero, an end of its range, or drifts away.

    Attributes:
        rate: rate of a drift, in the channel's SI unit a second.
    """

    target: Channel
    reads: Failure = "nan"
    rate: float = 0.0


@dataclass(frozen=True)
class StuckValve:
    """The servovalve's spool jams where it is."""


@dataclass(frozen=True)
class StuckBypass:
    """Ball and needle of a bypass stay where they are, whatever the host orders."""

    target: FaultName


@dataclass(frozen=True)
class Estop:
    """The emergency stop is pressed; when the fault ends, the button is pulled out again."""


@dataclass(frozen=True)
class LostCounts:
    """The encoder loses counts, which stay lost; with `flagged` its interface reports a fault."""

    counts: Annotated[int, _q("", -1_000_000, 1_000_000)] = 100
    flagged: bool = False


@dataclass(frozen=True)
class CanSilence:
    """A node of the CAN bus sends nothing any more."""

    target: CanDevice = "drive"


@dataclass(frozen=True)
class CanGarbage:
    """A node of the CAN bus sends nonsense beside its messages."""

    target: CanDevice = "drive"


@dataclass(frozen=True)
class StuckCan:
    """A node of the CAN bus answers, but obeys no commands: it stays in its state, or loaded."""

    target: CanDevice = "pump"


@dataclass(frozen=True)
class PumpWatchdogDead:
    """The pump unit's watchdog does not act: the unit stays loaded when its host falls silent."""


@dataclass(frozen=True)
class DriveFault:
    """The servovalve's electronics meet a fault of their own, and go to a fault state.

    Attributes:
        code: code of the emergency that they send (CiA 301); 0x3100 is the mains voltage.
    """

    code: Annotated[int, _q("", 1, 0xFFFF)] = 0x3100


@dataclass(frozen=True)
class MeterUnplugged:
    """The flow meters' serial line is unplugged, and plugged in again when the fault ends."""


@dataclass(frozen=True)
class MeterNoise:
    """Noise comes in on the flow meters' serial line."""


KINDS: Final[Mapping[str, type]] = {
    "delay": Delay,
    "drop": Drop,
    "garbage": Garbage,
    "wrong_transaction": WrongTransaction,
    "exception": Refusal,
    "disconnect": Disconnect,
    "frozen": Frozen,
    "sensor": Sensor,
    "stuck_valve": StuckValve,
    "stuck_bypass": StuckBypass,
    "estop": Estop,
    "lost_counts": LostCounts,
    "can_silence": CanSilence,
    "can_garbage": CanGarbage,
    "stuck_can": StuckCan,
    "pump_watchdog_dead": PumpWatchdogDead,
    "drive_fault": DriveFault,
    "meter_unplugged": MeterUnplugged,
    "meter_noise": MeterNoise,
}
"""The classes of all faults that can be injected, by their names in a script."""


@dataclass(frozen=True)
class WireFault:
    """One fault, and when it acts.

    Attributes:
        kind: one of `KINDS`.
        options: an instance of the class of that kind.
        at_s: time at which it begins, in s from the moment that `after` names.
        after: moment from which `at_s` counts: "start", when the fault is added, or "enable", when
            the valve is first enabled.
        for_s: how long it lasts, s; inf: to the end.
    """

    kind: str
    options: Any
    at_s: float = 0.0
    after: Start = "start"
    for_s: float = inf

    def described(self) -> dict[str, Any]:
        """Return the fault as the record and the control port show it."""
        return {"fault": self.kind, **asdict(self.options)}
