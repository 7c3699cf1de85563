"""The effects of each fault on the emulated rig, when it begins and when it ends."""

from collections.abc import Sequence
from typing import Any

from rig.emulator.can import CanDevices
from rig.emulator.instruments import Instruments
from rig.emulator.meters import MeterPanel
from rig.emulator.modbus import BypassIo, IoDevice, ModbusServer
from rig.emulator.plant import EmulatedPlant

from .wire_faults import (
    CanGarbage,
    CanSilence,
    Delay,
    Disconnect,
    DriveFault,
    Drop,
    Estop,
    Frozen,
    Garbage,
    LostCounts,
    MeterNoise,
    MeterUnplugged,
    PumpWatchdogDead,
    Refusal,
    Sensor,
    StuckBypass,
    StuckCan,
    StuckValve,
    WrongTransaction,
)


class NotServedError(ValueError):
    """Raised for faults of parts that the emulated rig lacks; `problems` names them."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = tuple(problems)


class FaultEffects:
    """Applies faults to the parts of an emulator.

    Args:
        plant: the plant, whose servovalve sticks.
        instruments: the transducers, which fail.
        node: the I/O device, whose buttons are pressed.
        daq: the server of the I/O device, whose wire fails.
        bypass: the bypass valves' I/O, whose wire fails and whose valves stick.
        can: the devices on CAN, whose electronics fail, if the rig has any.
        meters: the flow meters, which are unplugged; None if the rig has none.
    """

    def __init__(
        self,
        plant: EmulatedPlant,
        instruments: Instruments,
        node: IoDevice,
        daq: ModbusServer,
        bypass: BypassIo,
        can: CanDevices,
        meters: MeterPanel | None,
    ) -> None:
        self._plant = plant
        self._instruments = instruments
        self._node = node
        self._servers: dict[str, ModbusServer | BypassIo] = {"daq": daq, "bypass": bypass}
        self._valves = bypass.valves
        self._can = can
        self._meters = meters

    def require(self, *faults: Any) -> None:
        """Check that the rig has the parts that the faults concern.

        Raises:
            NotServedError: the rig lacks one.
        """
        problems = [problem for fault in faults if (problem := self._lacking(fault))]
        if problems:
            raise NotServedError(problems)

    def _lacking(self, fault: Any) -> str:
        """Return a sentence on the part that a fault concerns and the rig lacks; empty if none."""
        match fault:
            case MeterUnplugged() | MeterNoise() if self._meters is None:
                return "the rig has no flow meters on a serial line; leave the fault out"
            case DriveFault() if not self._can.has_drive:
                return "the rig has no servovalve on CAN; leave the fault out"
            case PumpWatchdogDead() if not self._can.has_pump:
                return "the rig has no pump on CAN; leave the fault out"
            case CanSilence() | CanGarbage() | StuckCan():
                has = {"drive": self._can.has_drive, "pump": self._can.has_pump}
                if not has[fault.target]:
                    return f"target: the rig has no {fault.target} on CAN; leave the fault out"
        return ""

    def apply(self, fault: Any, begins: bool) -> None:
        """Make a fault, an instance of a class of `KINDS`, begin or, if not `begins`, end."""
        match fault:
            case Frozen(target=target):
                if target == "daq":
                    self._node.frozen = begins
                else:
                    self._instruments.freeze(target, begins)
            case Sensor() if begins:
                self._instruments.fail(fault.target, fault.reads, fault.rate)
            case Sensor():
                self._instruments.mend(fault.target)
            case StuckValve():
                self._plant.stick_spool(begins)
            case StuckBypass():
                self._valves.stick(fault.target, begins)
            case Estop():
                self._node.press_estop(begins)
            case LostCounts() if begins:
                self._node.lose_counts(fault.counts, fault.flagged)
            case LostCounts():
                pass
            case MeterUnplugged() | MeterNoise():
                self._spoil_meters(fault, begins)
            case CanSilence() | CanGarbage() | StuckCan() | DriveFault() | PumpWatchdogDead():
                self._spoil_can(fault, begins)
            case _:
                self._spoil_wire(fault, begins)

    def _spoil_meters(self, fault: Any, begins: bool) -> None:
        if self._meters is None:
            return
        if isinstance(fault, MeterNoise):
            self._meters.noisy = begins
        elif begins:
            self._meters.unplug()
        else:
            self._meters.plug_in()

    def _spoil_can(self, fault: Any, begins: bool) -> None:
        if isinstance(fault, DriveFault):
            if begins and self._can.valve is not None:
                self._can.valve.fail(fault.code)
            return
        if isinstance(fault, PumpWatchdogDead):
            if self._can.pump is not None:
                self._can.pump.faults.watchdog_dead = begins
            return
        node = self._can.valve if fault.target == "drive" else self._can.pump
        if node is None:
            return
        match fault:
            case CanSilence():
                node.faults.silent = begins
            case CanGarbage():
                node.faults.garbage = begins
            case StuckCan():
                node.faults.stuck = begins

    def _spoil_wire(self, fault: Any, begins: bool) -> None:
        server = self._servers[fault.target]
        wire = server.wire
        match fault:
            case Delay():
                wire.delay_s = fault.by if begins else 0.0
            case Drop(what="requests"):
                wire.requests_lost = begins
            case Drop():
                wire.replies_lost = begins
            case Garbage():
                wire.garbage = begins
            case WrongTransaction():
                wire.wrong_transaction = begins
            case Refusal():
                wire.exception = fault.code if begins else 0
            case Disconnect():
                wire.refuses = begins
                if begins:
                    server.disconnect()
            case _:
                raise ValueError(f"{type(fault).__name__}: no such effect")
