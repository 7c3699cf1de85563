"""The whole emulated rig: one plant, the devices around it, and one event loop that serves them."""

import asyncio
import gc
import time
from collections import Counter
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, Final

from rig.configuration import Rig
from rig.emulator.can import CanDevices
from rig.emulator.modbus import IDENTITY, BypassIo, IoDevice, IoNode, MappedDevice, ModbusServer
from rig.emulator.script import NOTHING, ControlPort, Injection, Script

from .addresses import Endpoints
from .blocking_valves import conductance
from .instruments import Instruments
from .meters import MeterPanel
from .operator_panel import EmulatedOperator
from .plant import Clock, EmulatedPlant
from .record import Record
from .sole_use import sole_use

_TEND_S: Final = 5e-3
"""Time in s between two calls of `tend`; exchanges bring the plant up to date by themselves."""
_SUMMARY_NS: Final = 1_000_000_000
"""Time in ns between two events that count exchanges, which are not recorded one by one."""


class Emulator:
    """An emulated rig, whose devices are served at the addresses that its drivers use.

    Args:
        rig: the rig that is emulated; its plant is the true one, and it is wired as it says.
        endpoints: addresses of its parts.
        record: takes note of everything that the emulator receives.
        script: faults and operator; by default there is no fault, and nobody presses a button.
        seed: seed of the sensors' noise.
        position: where the ram rests at first, m; None for mid stroke.
        clock: returns the time in ns.

    Attributes:
        ports: TCP port or path at which each part is served, by name, once the emulator is open.
        record: as given.
        plant, instruments, can, node, operator, daq, bypass, meters: the parts on which faults act;
            `daq` serves `node`, and `meters` is None if the rig has no flow meters.
        injection: the faults.
    """

    def __init__(
        self,
        rig: Rig,
        endpoints: Endpoints,
        record: Record,
        *,
        script: Script = NOTHING,
        seed: int = 0,
        position: float | None = None,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self.record = record
        self.ports: dict[str, int | str] = {}
        self._endpoints = endpoints
        self._clock = clock
        self._script = script
        self.plant = EmulatedPlant(
            rig.plant,
            rig.sensors,
            bypass_valves=rig.bypass_valves,
            return_resistance=rig.return_valve.maximum if rig.return_valve else 0.0,
            pump_loaded=endpoints.pump is None,
            seed=seed,
            clock=clock,
            position=position,
            spool_sensor=rig.has_spool_sensor,
            supply_pressure_sensor=rig.has_supply_pressure_sensor,
            load_cell=rig.has_load_cell,
        )
        self.instruments = Instruments(self.plant, rig.wiring)
        self.can = CanDevices(self.plant, record, endpoints.drive, endpoints.pump)
        valve = self._turned_valve if rig.wiring.valve == "inverted" else self.can.set_analog
        parts = self.instruments, valve, record
        known = endpoints.map
        self.node: IoDevice
        if known is None or known.identity.value == IDENTITY:
            self.node = IoNode(*parts)
        else:
            self.node = MappedDevice(known, *parts)
        self.operator = EmulatedOperator(self.node, clock, script.attentive)
        self.daq = ModbusServer("daq", self.node, record)
        # All balls are as slow as the rig's slowest one.
        travels = [valve.ball_travel_s for valve in rig.bypass_valves.values()]
        self._blocking_valves = rig.blocking_valves
        self.bypass = BypassIo(
            record, clock, max(travels, default=0.5),
            rig.blocking_valves.travel_s if rig.blocking_valves is not None else None,
        )  # fmt: skip
        self._positions = self.bypass.valves.positions()
        self._blocking = self.bypass.valves.blocking()
        self.meters: MeterPanel | None = None
        if endpoints.meters is not None:
            self.meters = MeterPanel(endpoints.meters, lambda: self.instruments.read()[6:], record)
        self.injection = Injection(self, record, clock)
        self._control = ControlPort(self)
        self._locks = ExitStack()
        self._stopped = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._summed_ns = clock()
        self._summed = 0

    def _turned_valve(self, command_V: float, at_ns: int) -> None:  # noqa: N803
        """Pass on the output of the I/O device to a valve whose wires are exchanged."""
        self.can.set_analog(-command_V, at_ns)

    async def open(self) -> None:
        """Begin to serve all parts; the times of the script count from now.

        Raises:
            AddressError: an address is in use, or cannot be used. After this error and the others,
                nothing is served.
            DriverError: the CAN bus cannot be opened.
            LinkError: a serial line cannot be made.
            NotServedError: a fault of the script concerns a part that the rig does not have.
            ServedAlreadyError: another emulator on this machine serves its CAN bus or serial line.
        """
        try:
            self._locks.enter_context(sole_use(self._endpoints))
            await self._open(self._endpoints)
            self.injection.script(self._script.faults)
        except BaseException:
            await self.close()
            raise
        self.record.note("ready", ports=self.ports)
        # Objects that exist now stay, so that the collector need not look through them again.
        gc.freeze()

    async def _open(self, at: Endpoints) -> None:
        self.ports["daq"] = await self.daq.open(*at.daq)
        if isinstance(at.bypass, Path):
            await self.bypass.open_serial(at.bypass)
            self.ports["bypass"] = str(at.bypass)
        elif at.bypass is not None:
            self.ports["bypass"] = await self.bypass.open(*at.bypass)
        self.ports.update(self.can.open())
        if self.meters is not None:
            self.meters.plug_in()
            self._tasks.append(asyncio.create_task(self.meters.run()))
            self.ports["meters"] = str(at.meters)
        if at.control is not None:
            self.ports["control"] = await self._control.open(*at.control)

    async def run(self) -> None:
        """Serve until `stop` is called; raise the error of a part that fails meanwhile.

        Without one of its devices the emulator would be another rig, and nobody would know why.
        """
        while not self._stopped.is_set():
            self.tend()
            for task in (*self._tasks, *self.can.tasks):
                if task.done():
                    task.result()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopped.wait(), _TEND_S)

    def tend(self) -> None:
        """Do what is due by the clock: advance plant, watchdogs, operator, valves and faults."""
        self.plant.catch_up()
        self.node.tend()
        self.operator.tend()
        self.can.tend()
        self._move_bypasses()
        if self.node.enabled:
            self.injection.valve_enabled()
        self.injection.tend()
        self._summarize()

    def _move_bypasses(self) -> None:
        """Set the plant to the true positions of the bypass valves and blocking valves."""
        blocking, valves = self.bypass.valves.blocking(), self._blocking_valves
        if valves is not None and blocking != self._blocking:
            first, second = (conductance(shut, valves) for shut in blocking.values())
            self.plant.set_blocking(first, second)
            self._blocking = blocking
        positions = self.bypass.valves.positions()
        for bypass, (ball, needle) in positions.items():
            if (ball, needle) != self._positions[bypass]:
                self.plant.set_bypass(bypass, ball, needle)
        self._positions = positions

    def _summarize(self) -> None:
        """Record the number of exchanges since the last summary, if there were any, once a second.

        The record's trace is then passed to the kernel.
        """
        now = self._clock()
        if now - self._summed_ns < _SUMMARY_NS:
            return
        new = self.node.exchanges - self._summed
        self._summed_ns, self._summed = now, self.node.exchanges
        if new:
            self.record.note("exchanges", now, new=new, **self.node.state())
        self.record.flush()

    def stop(self) -> None:
        """Make `run` return soon; it must be called in the event loop's thread."""
        self._stopped.set()

    async def close(self) -> None:
        """Stop serving; repeated calls do no harm."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []
        await self.can.close()
        if self.meters is not None:
            self.meters.close()
        self.bypass.close()
        self._control.close()
        self.daq.close()
        self._locks.close()

    def status(self) -> dict[str, Any]:
        """Return the states of all devices, of the plant and of the faults.

        That of the plant is its true state with the fault coefficients that act, SI.
        """
        truth = self.plant.truth
        return {
            "time_ns": self.plant.time_ns,
            "daq": {"requests": self.daq.requests, **self.node.state()},
            "bypass": self.bypass.state(),
            "can": self.can.state(),
            "plant": {**truth._asdict(), **self.plant.coefficients},
            "faults": self.injection.state(),
        }

    def summary(self) -> dict[str, int]:
        """Return the number of exchanges since the start, and how often each event was recorded.

        The key `exchange` has the first; every other key is the name of an event, which counts as
        often as it stands among the latest 10 000.
        """
        events = Counter(event["event"] for event in self.record.events)
        return {"exchange": self.node.exchanges, **events}
