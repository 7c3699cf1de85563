"""The emulated devices on CAN, each on the bus that its driver uses in the rig file."""

import asyncio
from typing import Any

from rig.emulator.plant import COMMAND_RANGE, EmulatedPlant
from rig.emulator.record import Record
from rig.io import CanOptions, open_bus, python_can as can

from .nodes import Node, serve
from .pump_node import PumpNode
from .valve_node import ValveNode


class CanDevices:
    """The servovalve's electronics and the pump unit, either or both; they may share a bus.

    Args:
        plant: the plant whose valve and pump they drive.
        record: takes note of what they receive.
        drive: `CanValveOptions` of the servovalve; None: it is an analog one.
        pump: `CanPumpOptions` of the pump unit; None: the pump always runs.

    Attributes:
        valve: the servovalve's electronics, once open; None if there are none.
        pump: the pump unit, once open; None if there is none.
        tasks: the tasks that serve them, one for each bus; a task that ends before `close` has
            failed.
    """

    def __init__(self, plant: EmulatedPlant, record: Record, drive: Any, pump: Any) -> None:
        self.valve: ValveNode | None = None
        self.pump: PumpNode | None = None
        self.has_drive, self.has_pump = drive is not None, pump is not None
        self._plant = plant
        self._record = record
        self._drive_options, self._pump_options = drive, pump
        self._buses: dict[tuple[str, str, int], can.BusABC] = {}
        self.tasks: list[asyncio.Task[None]] = []

    def open(self) -> dict[str, str]:
        """Begin to serve; return the bus of each device by its name, "drive" or "pump".

        Raises:
            DriverError: a bus cannot be opened.
        """
        nodes: dict[tuple[str, str, int], list[Node]] = {}
        places = {}
        if self._drive_options is not None:
            self.valve = self._valve(self._drive_options)
            nodes.setdefault(_key(self._drive_options), []).append(self.valve)
            places["drive"] = _shown(self._drive_options)
        if self._pump_options is not None:
            self.pump = self._pump(self._pump_options)
            nodes.setdefault(_key(self._pump_options), []).append(self.pump)
            places["pump"] = _shown(self._pump_options)
        for key, bus in self._buses.items():
            self.tasks.append(asyncio.create_task(serve(bus, nodes[key])))
        return places

    def _valve(self, options: Any) -> ValveNode:
        return ValveNode(
            self._bus("drive", options).send,
            lambda: self._plant.truth.spool,
            options.full_stroke,
            options.node,
            self._record.note,
        )

    def _pump(self, options: Any) -> PumpNode:
        return PumpNode(
            self._bus("pump", options).send,
            options.dbc,
            lambda: self._plant.truth.supply_pressure,
            self._plant.load_pump,
            self._record.note,
        )

    def _bus(self, part: str, options: CanOptions) -> can.BusABC:
        key = _key(options)
        if key not in self._buses:
            self._buses[key] = open_bus(part, options)
        return self._buses[key]

    def acting_command(self, command_V: float) -> float:  # noqa: N803
        """Return the command in V that moves the spool, given the analog one of the I/O node.

        It is the analog one if the servovalve has no electronics on CAN.
        """
        if self.valve is None:
            return command_V
        return COMMAND_RANGE * self.valve.acting_command(command_V / COMMAND_RANGE)

    def state(self) -> dict[str, Any]:
        """Return the states of the CAN devices for the control port."""
        return {
            "drive": self.valve.state.name if self.valve is not None else "analog",
            "pump_loaded": self._plant.pump_loaded,
        }

    async def close(self) -> None:
        """Leave the buses; repeated calls do no harm."""
        for task in self.tasks:
            task.cancel()
        await asyncio.gather(*self.tasks, return_exceptions=True)
        self.tasks = []
        for bus in self._buses.values():
            bus.shutdown()
        self._buses = {}


class ValvePath:
    """The path from the I/O node's output to the spool, through the servovalve's own electronics.

    Args:
        plant: the plant whose spool is moved.
        devices: devices on CAN, with the valve's electronics if the rig has them.
    """

    def __init__(self, plant: EmulatedPlant, devices: CanDevices) -> None:
        self._plant = plant
        self._devices = devices
        self._analog = 0.0
        self._acting = 0.0

    def set_analog(self, command_V: float, at_ns: int) -> None:  # noqa: N803
        """Set the output of the I/O node in V, from a moment in ns on."""
        self._analog = command_V
        self._drive(at_ns)

    def tend(self) -> None:
        """Update the spool's command, since the electronics' state changes by itself."""
        self._drive(None)

    def _drive(self, at_ns: int | None) -> None:
        acting = self._devices.acting_command(self._analog)
        if acting != self._acting:
            self._acting = acting
            self._plant.drive_valve(acting, at_ns)


def _key(options: CanOptions) -> tuple[str, str, int]:
    return options.interface, options.channel, options.port


def _shown(options: CanOptions) -> str:
    port = f":{options.port}" if options.interface == "udp_multicast" else ""
    return f"{options.interface} {options.channel}{port}"
