"""The faults that can be injected on the emulated rig, in wires, sensors, valves and devices."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from rig.emulator.instruments import Channel, Failure
from rig.plant import FaultName, Quantity as _Quantity

if TYPE_CHECKING:
    from rig.emulator.application import Emulator
    from rig.emulator.modbus import BypassIo, ModbusServer

ModbusDevice = Literal["daq", "bypass"]
CanDevice = Literal["drive", "pump"]
Start = Literal["start", "enable"]


@dataclass(frozen=True)
class Fault:
    """A fault of an emulated rig; the fields of a subclass are its keys in a script."""

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig lacks the part that the fault concerns, or "" if not."""
        return ""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the fault begin or, if not `begins`, end; the rig must not lack the part."""
        raise NotImplementedError


@dataclass(frozen=True)
class _OfWire(Fault):
    """A fault of the wire to a Modbus device."""

    target: ModbusDevice = "daq"

    def _server(self, emulator: "Emulator") -> "ModbusServer | BypassIo":
        return emulator.daq if self.target == "daq" else emulator.bypass


@dataclass(frozen=True)
class Delay(_OfWire):
    """Replies come late by the time `by`, s."""

    by: Annotated[float, _Quantity("s", 1e-4, 60.0, "", "")] = 5e-3

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make replies late, or prompt again."""
        self._server(emulator).wire.delay_s = self.by if begins else 0.0


@dataclass(frozen=True)
class Drop(_OfWire):
    """Replies or requests are lost, as `what` says."""

    what: Literal["replies", "requests"] = "replies"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Lose replies or requests, or pass them again."""
        wire = self._server(emulator).wire
        if self.what == "requests":
            wire.requests_lost = begins
        else:
            wire.replies_lost = begins


class Garbage(_OfWire):
    """Replies are random bytes of the right length."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Replace the bytes of replies, or leave them again."""
        self._server(emulator).wire.garbage = begins


class WrongTransaction(_OfWire):
    """Replies have the number of another transaction."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Change the transaction of replies, or leave it again."""
        self._server(emulator).wire.wrong_transaction = begins


@dataclass(frozen=True)
class Refusal(_OfWire):
    """The device answers every request with an exception, and does nothing.

    Attributes:
        code: code of the Modbus exception.
    """

    code: Annotated[int, _Quantity("", 1, 11, "", "")] = 4

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the device refuse, or obey again."""
        self._server(emulator).wire.exception = self.code if begins else 0


class Disconnect(_OfWire):
    """Every connection breaks, and new ones are refused while the fault lasts."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Break the connections, or admit new ones again."""
        server = self._server(emulator)
        server.wire.refuses = begins
        if begins:
            server.disconnect()


@dataclass(frozen=True)
class Frozen(Fault):
    """A channel keeps its reading; with `daq` the whole I/O device repeats its last sample."""

    target: Channel | Literal["daq"] = "daq"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Freeze the channel or the device, or let it go on."""
        if self.target == "daq":
            emulator.node.frozen = begins
        else:
            emulator.instruments.freeze(self.target, begins)


@dataclass(frozen=True)
class Sensor(Fault):
    """A transducer fails: it reads not a number, zero, an end of its range, or drifts away.

    Attributes:
        target: name of the transducer's channel.
        reads: "nan", "zero", "low" or "high" (the ends of the range), or "drift".
        rate: rate of a drift, in the channel's SI unit a second; else without effect.
    """

    target: Channel
    reads: Failure = "nan"
    rate: float = 0.0

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the transducer fail, or mend it."""
        if begins:
            emulator.instruments.fail(self.target, self.reads, self.rate)
        else:
            emulator.instruments.mend(self.target)


@dataclass(frozen=True)
class StuckValve(Fault):
    """The servovalve's spool jams where it is."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Jam the spool, or free it."""
        emulator.plant.stick_spool(begins)


@dataclass(frozen=True)
class StuckBypass(Fault):
    """Ball and needle of a bypass stay where they are, whatever the host orders."""

    target: FaultName

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Jam the valves of the bypass, or free them."""
        emulator.bypass.valves.stick(self.target, begins)


@dataclass(frozen=True)
class StuckBlocking(Fault):
    """A blocking valve stays where it is, whatever the host orders."""

    target: Literal["blocking_1", "blocking_2"]

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig has no blocking valves, or "" if it has."""
        if emulator.bypass.valves.blocking():
            return ""
        return f"target: the rig has no {self.target} valve; leave the fault out"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Jam the valve, or free it."""
        emulator.bypass.valves.stick(self.target, begins)


@dataclass(frozen=True)
class Estop(Fault):
    """The emergency stop is pressed; when the fault ends, the button is pulled out again."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Press the emergency stop, or pull it out."""
        emulator.node.press_estop(begins)


@dataclass(frozen=True)
class LostCounts(Fault):
    """The encoder loses counts, which stay lost; with `flagged` its interface reports a fault."""

    counts: Annotated[int, _Quantity("", -1_000_000, 1_000_000, "", "")] = 100
    flagged: bool = False

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the encoder lose counts if the fault begins; its end brings nothing back."""
        if begins:
            emulator.node.lose_counts(self.counts, self.flagged)


@dataclass(frozen=True)
class _OfCan(Fault):
    """A fault of a node of the CAN bus."""

    target: CanDevice = "drive"

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig lacks the node, or "" if it has."""
        there = self._node(emulator) is not None
        return "" if there else f"target: the rig has no {self.target} on CAN; leave the fault out"

    def _node(self, emulator: "Emulator") -> Any:
        return emulator.can.valve if self.target == "drive" else emulator.can.pump


class CanSilence(_OfCan):
    """A node of the CAN bus sends nothing any more."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Silence the node, or let it send again."""
        self._node(emulator).faults.silent = begins


class CanGarbage(_OfCan):
    """A node of the CAN bus sends nonsense beside its messages."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the node send nonsense, or stop that."""
        self._node(emulator).faults.garbage = begins


@dataclass(frozen=True)
class StuckCan(_OfCan):
    """A node of the CAN bus sends as usual, but obeys no commands.

    The servovalve's electronics stay in their state, and the pump unit stays loaded or unloaded.
    """

    target: CanDevice = "pump"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the node stick in its state, or obey again."""
        self._node(emulator).faults.stuck = begins


@dataclass(frozen=True)
class PumpWatchdogDead(Fault):
    """The pump unit's watchdog does not act: the unit stays loaded when its host falls silent."""

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig lacks the pump unit, or "" if it has."""
        return "" if emulator.can.pump else "the rig has no pump on CAN; leave the fault out"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Switch the watchdog of the unit off, or on again."""
        assert emulator.can.pump is not None
        emulator.can.pump.faults.watchdog_dead = begins


@dataclass(frozen=True)
class DriveFault(Fault):
    """The servovalve's electronics meet a fault of their own, and go to a fault state.

    Attributes:
        code: code of the emergency that they send (CiA 301); 0x3100 is the mains voltage.
    """

    code: Annotated[int, _Quantity("", 1, 0xFFFF, "", "")] = 0x3100

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig lacks the servovalve, or "" if it has."""
        return "" if emulator.can.valve else "the rig has no servovalve on CAN; leave the fault out"

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Make the electronics meet the fault if it begins; its end does nothing.

        Only a reset by the host brings the electronics out of their fault state.
        """
        assert emulator.can.valve is not None
        if begins:
            emulator.can.valve.fail(self.code)


@dataclass(frozen=True)
class _OfMeters(Fault):
    """A fault of the flow meters' serial line."""

    def lacking(self, emulator: "Emulator") -> str:
        """Return what is wrong if the rig lacks the meters, or "" if it has."""
        without = "the rig has no flow meters on a serial line; leave the fault out"
        return "" if emulator.meters else without


class MeterUnplugged(_OfMeters):
    """The flow meters' serial line is unplugged, and plugged in again when the fault ends."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Unplug the line, or plug it in."""
        assert emulator.meters is not None
        if begins:
            emulator.meters.unplug()
        else:
            emulator.meters.plug_in()


class MeterNoise(_OfMeters):
    """Noise comes in on the flow meters' serial line."""

    def act(self, emulator: "Emulator", begins: bool) -> None:
        """Put noise on the line, or stop it."""
        assert emulator.meters is not None
        emulator.meters.noisy = begins


KINDS: Final[Mapping[str, type[Fault]]] = {
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
    "stuck_blocking": StuckBlocking,
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
            the valve is first enabled, or when the fault is added if that is later.
        for_s: how long it lasts, s; inf: to the end.
    """

    kind: str
    options: Any
    at_s: float = 0.0
    after: Start = "start"
    for_s: float = inf

    def described(self) -> dict[str, Any]:
        """Return the fault, without its times, as the record and the control port show it."""
        return {"fault": self.kind, **asdict(self.options)}
