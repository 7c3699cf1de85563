"""The emulated devices on CAN, each on the bus that its driver uses in the rig file."""

import asyncio
from collections import defaultdict
from typing import Any

from rig.emulator.plant import COMMAND_RANGE, EmulatedPlant
from rig.emulator.record import Record
from rig.io import CanOptions, open_bus, python_can as can

from .nodes import Node, Send, serve
from .pump_node import PumpNode
from .valve_node import ValveNode


class CanDevices:
    """The servovalve's electronics and the pump unit, either or both; they may share a bus.

    The voltage of the I/O node's output reaches the spool by way of the servovalve's electronics,
    if the rig has them.

    Args:
        plant: the plant whose valve and pump they drive.
        record: takes note of what they receive.
        drive: `CanValveOptions` of the servovalve; None: it is an analog one.
        pump: `CanPumpOptions` of the pump unit; None: the pump always runs.

    Attributes:
        valve: the servovalve's electronics; None if there are none.
        pump: the pump unit; None if there is none.
        tasks: the tasks that serve them, one for each bus; a task that ends before `close` has
            failed.
    """

    def __init__(self, plant: EmulatedPlant, record: Record, drive: Any, pump: Any) -> None:
        self.valve: ValveNode | None = None
        self.pump: PumpNode | None = None
        self.tasks: list[asyncio.Task[None]] = []
        self._plant = plant
        self._note = record.note
        self._analog = self._acting = 0.0
        self._devices: dict[str, tuple[CanOptions, Node]] = {}
        self._buses: dict[str, can.BusABC] = {}
        if drive is not None:
            self.valve = ValveNode(
                self._sender(drive),
                lambda: plant.truth.spool,
                drive.full_stroke,
                drive.node,
                record.note,
            )
            self._devices["drive"] = drive, self.valve
        if pump is not None:
            self.pump = PumpNode(
                self._sender(pump),
                pump.dbc,
                lambda: plant.truth.supply_pressure,
                plant.load_pump,
                record.note,
            )
            self._devices["pump"] = pump, self.pump

    def _sender(self, options: CanOptions) -> Send:
        return lambda frame: self._buses[options.bus].send(frame)

    def open(self) -> dict[str, str]:
        """Begin to serve; return the bus of each device by its name, "drive" or "pump".

        Raises:
            DriverError: a bus cannot be opened.
        """
        nodes = defaultdict(list)
        for part, (options, node) in self._devices.items():
            if options.bus not in self._buses:
                self._buses[options.bus] = open_bus(part, options)
            nodes[options.bus].append(node)
        for name, bus in self._buses.items():
            self.tasks.append(asyncio.create_task(serve(bus, name, nodes[name], self._note)))
        return {part: options.bus for part, (options, _) in self._devices.items()}

    def set_analog(self, command_V: float, at_ns: int) -> None:  # noqa: N803
        """Pass on the output of the I/O node (V), which acts from a moment in ns on."""
        self._analog = command_V
        self.tend(at_ns)

    def tend(self, at_ns: int | None = None) -> None:
        """Give the plant the command that drives the spool now, if it has changed.

        It acts from now on, or from the moment `at_ns`. Call this often: the servovalve's
        electronics may change their state, and with it the command, at any time.
        """
        acting = self._analog
        if self.valve is not None:
            acting = COMMAND_RANGE * self.valve.acting_command(acting / COMMAND_RANGE)
        if acting != self._acting:
            self._acting = acting
            self._plant.drive_valve(acting, at_ns)

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
