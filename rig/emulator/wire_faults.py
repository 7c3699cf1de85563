"""What can be made to fail on the emulated rig: the wires, the sensors, the valves, the operator.

A script is a YAML file with a list `faults`; each names its `fault`, and when it begins and ends:

    faults:
      - {fault: delay, target: daq, by: 5 ms, after: enable, at: 2 s, for: 500 ms}
      - {fault: sensor, target: pressure_1_Pa, reads: high, at: 10 s}
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from pydantic import create_model

from rig.configuration.document import Located, Sources
from rig.configuration.fields import Physical
from rig.configuration.options import read_options
from rig.configuration.problems import Place, suggestion
from rig.configuration.validation import Schema, check, shown
from rig.plant.parameters import Quantity as _Quantity

from .instruments import Channel, Failure

ModbusDevice = Literal["daq", "bypass"]
CanDevice = Literal["drive", "pump"]
Bypass = Literal[
    "external_leakage_1",
    "external_leakage_2",
    "internal_leakage",
    "supply_leakage",
    "return_blockage",
]
Start = Literal["start", "enable"]


def _q(unit: str, lower: float, upper: float) -> _Quantity:
    return _Quantity(unit, lower, upper, "", "")


@dataclass(frozen=True)
class Delay:
    """Replies come late by so much."""

    target: ModbusDevice = "daq"
    by: Annotated[float, _q("s", 1e-4, 60.0)] = 5e-3


@dataclass(frozen=True)
class Drop:
    """Replies, or requests, are lost."""

    target: ModbusDevice = "daq"
    what: Literal["replies", "requests"] = "replies"


@dataclass(frozen=True)
class Garbage:
    """Replies are random bytes of the right length."""

    target: ModbusDevice = "daq"


@dataclass(frozen=True)
class WrongTransaction:
    """Replies bear another transaction's number."""

    target: ModbusDevice = "daq"


@dataclass(frozen=True)
class Refusal:
    """The device answers every request with an exception, and does nothing."""

    target: ModbusDevice = "daq"
    code: Annotated[int, _q("", 1, 11)] = 4


@dataclass(frozen=True)
class Disconnect:
    """Every connection breaks, and nobody gets a new one as long as it lasts."""

    target: ModbusDevice = "daq"


@dataclass(frozen=True)
class Frozen:
    """A channel stays at its value; `daq`: the whole device returns its last sample for ever."""

    target: Channel | Literal["daq"] = "daq"


@dataclass(frozen=True)
class Sensor:
    """A transducer fails: not a number, zero, the low or high end of its range, or drifting off.

    Attributes:
        rate: of a drift, in the channel's SI unit a second.
    """

    target: Channel
    reads: Failure = "nan"
    rate: float = 0.0


@dataclass(frozen=True)
class StuckValve:
    """The servovalve's spool jams where it is."""


@dataclass(frozen=True)
class StuckBypass:
    """Ball and needle of a bypass stay where they are, whatever they are told."""

    target: Bypass


@dataclass(frozen=True)
class Estop:
    """Somebody presses the emergency stop, and pulls it out again when it ends."""


@dataclass(frozen=True)
class LostCounts:
    """The encoder loses counts, which stay lost; `flagged` if its interface notices."""

    counts: Annotated[int, _q("", -1_000_000, 1_000_000)] = 100
    flagged: bool = False


@dataclass(frozen=True)
class CanSilence:
    """A node of the CAN bus says nothing any more."""

    target: CanDevice = "drive"


@dataclass(frozen=True)
class CanGarbage:
    """A node of the CAN bus sends nonsense besides."""

    target: CanDevice = "drive"


@dataclass(frozen=True)
class StuckCan:
    """A node of the CAN bus hears, but obeys no more: a pump unit stays loaded."""

    target: CanDevice = "pump"


@dataclass(frozen=True)
class DriveFault:
    """The servovalve's electronics meet a fault of their own, and leave for a fault state.

    Attributes:
        code: of the emergency that they send (CiA 301): 0x3100 is the mains voltage.
    """

    code: Annotated[int, _q("", 1, 0xFFFF)] = 0x3100


@dataclass(frozen=True)
class MeterUnplugged:
    """The flow meters' serial line is pulled out, and plugged in again when it ends."""


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
    "drive_fault": DriveFault,
    "meter_unplugged": MeterUnplugged,
    "meter_noise": MeterNoise,
}
"""What can be injected, by its name in a script, with its options."""


@dataclass(frozen=True)
class WireFault:
    """One fault, and when it acts.

    Attributes:
        kind: one of `KINDS`.
        options: an instance of its class.
        at_s: when it begins, in s.
        after: from when that counts: the emulator's start, or the first time the valve is enabled.
        for_s: how long it lasts; inf: to the end.
    """

    kind: str
    options: Any
    at_s: float = 0.0
    after: Start = "start"
    for_s: float = inf

    def described(self) -> dict[str, Any]:
        """Return it as the record and the control port show it."""
        return {"fault": self.kind, **asdict(self.options)}


_TIMES: Final = ("at", "after", "for")
_TIMES_SCHEMA: Final = create_model(
    "WireFaultFile",
    __base__=Schema,
    # `for` is no name that a class body could hold.
    **{  # type: ignore[call-overload]
        "fault": (str, ...),
        "at": (Annotated[float, Physical("s", 0.0, 1e6, 1.0)], 0.0),
        "after": (Start, "start"),
        "for": (Annotated[float, Physical("s", 1e-3, 1e6, 1.0)], inf),
    },
)


def read_script(path: Path) -> tuple[WireFault, ...]:
    """Return the faults of a script.

    Raises:
        ConfigError: every problem of the file.
    """
    sources = Sources()
    root = sources.read_yaml(path)
    faults: list[WireFault] = []
    if root is not None:
        entries = root.get("faults")
        for key, item in root.items():
            if key != "faults":
                sources.problems.add(item.place, key, "", "is not a known key", "keys: faults")
        if entries is None or not isinstance(entries.value, list):
            place = entries.place if entries else root.place
            remedy = "write `faults:` and a list: - {fault: ..., at: ...}"
            sources.problems.add(place, "faults", "", "is not a list", remedy)
        else:
            found = (read_fault(item, sources) for item in entries.elements())
            faults = [fault for fault in found if fault is not None]
    sources.problems.raise_if_any()
    return tuple(faults)


def fault_from(request: Mapping[str, Any]) -> WireFault:
    """Return a fault given as plain values, with the keys of a script.

    Raises:
        ConfigError: every problem with it.
    """
    sources = Sources()
    fault = read_fault(_located(request, "request"), sources)
    sources.problems.raise_if_any()
    assert fault is not None
    return fault


def _located(value: Any, name: str) -> Located:
    """Return plain values as if they stood in a file named `request`."""
    place = Place(Path("request"), 0, 0)
    if isinstance(value, Mapping):
        return Located({str(k): _located(v, str(k)) for k, v in value.items()}, place, name)
    if isinstance(value, list):
        return Located([_located(v, f"{name}[{i}]") for i, v in enumerate(value)], place, name)
    return Located(value, place, name)


def read_fault(item: Located, sources: Sources) -> WireFault | None:
    """Return one fault; None, with problems added to the sources', if it cannot be made."""
    entry = item.get("fault")
    if entry is None or str(entry.value) not in KINDS:
        place, value = (entry.place, shown(entry)) if entry else (item.place, "")
        remedy = suggestion(value, tuple(KINDS), "faults")
        sources.problems.add(place, "fault", value, "is not a known fault", remedy)
        return None
    keys = dict(item.items())
    own = {key: keys.pop(key) for key in ("fault", *_TIMES) if key in keys}
    times = check(_TIMES_SCHEMA, Located(own, item.place, item.name), sources.problems)
    options = read_options(KINDS[str(entry.value)], Located(keys, item.place, item.name), sources)
    if times is None or options is None:
        return None
    given = times.model_dump()
    return WireFault(given["fault"], options, given["at"], given["after"], given["for"])
