"""The whole emulated rig: one plant, the devices around it, and one event loop that serves them."""

import asyncio
import gc
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np

from rig.configuration import Rig
from rig.emulator.can import CanDevices, ValvePath
from rig.emulator.modbus import IDENTITY, BypassIo, IoDevice, IoNode, MappedDevice, ModbusServer
from rig.emulator.script import NOTHING, ControlPort, FaultEffects, Injection, Script
from rig.io import RegisterMap
from rig.plant import Reading

from .addresses import Endpoints
from .instruments import Instruments
from .meters import MeterPanel
from .operator_panel import EmulatedOperator
from .plant import Clock, EmulatedPlant
from .record import Record

_TEND_S: Final = 5e-3
"""How often what nobody looks at is brought up to date; exchanges do so themselves."""
_SUMMARY_NS: Final = 1_000_000_000
"""How often the record sums up exchanges, which it does not name one by one."""


class Emulator:
    """A rig that is not there, served where its drivers look for it.

    Args:
        rig: what it is made of; its plant is the truth.
        endpoints: where it is served.
        record: takes note of all it receives.
        script: what happens by itself; nothing, if not given, and nobody presses a button.
        seed: fixes the sensors' noise.
        clock: returns the time in ns.

    Attributes:
        ports: TCP port, or path, at which each part is served, by name, once it is open.
    """

    def __init__(
        self,
        rig: Rig,
        endpoints: Endpoints,
        record: Record,
        *,
        script: Script = NOTHING,
        seed: int = 0,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self.record = record
        self.ports: dict[str, int | str] = {}
        self._endpoints = endpoints
        self._clock = clock
        self._script = script
        self.plant = _plant(rig, seed, clock, pump_loaded=endpoints.pump is None)
        self.instruments = Instruments(self.plant)
        self._can = CanDevices(self.plant, record, endpoints.drive, endpoints.pump)
        self._valve_path = ValvePath(self.plant, self._can)
        self.node = _io_device(endpoints.map, self.instruments, self._valve_path.set_analog, record)
        self.operator = EmulatedOperator(self.node, clock, script.attentive)
        self._daq = ModbusServer("daq", self.node, record)
        self._bypass = _bypass_io(rig, record, clock)
        self._positions = self._bypass.positions()
        self._meters = _meter_panel(endpoints.meters, self._metered, record)
        effects = FaultEffects(
            self.plant,
            self.instruments,
            self.node,
            self._daq,
            self._bypass,
            self._can,
            self._meters,
        )
        self.injection = Injection(effects, record, clock)
        self._control = ControlPort(self)
        self._stopped = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._summed_ns = clock()
        self._summed = 0

    def _metered(self) -> tuple[float, ...]:
        """Return the flow meters' readings in m^3/s."""
        return tuple(self.instruments.read()[6:])

    async def open(self) -> None:
        """Begin to serve everything; the script's time begins.

        Raises:
            AddressError: an address is in use, or not to be had; nothing is served then.
            DriverError: there is no such CAN bus; nothing is served then.
            LinkError: a serial line cannot be made; nothing is served then.
            NotServedError: a fault of the script concerns a part that the rig does not have.
        """
        try:
            await self._open(self._endpoints)
            self.injection.script(self._script.faults)
        except BaseException:
            await self.close()
            raise
        self.record.note("ready", ports=self.ports)
        # What is there now stays: the collector need not look through it at every turn.
        gc.freeze()

    async def _open(self, at: Endpoints) -> None:
        self.ports["daq"] = await self._daq.open(*at.daq)
        if isinstance(at.bypass, Path):
            await self._bypass.open_serial(at.bypass)
            self.ports["bypass"] = str(at.bypass)
        elif at.bypass is not None:
            self.ports["bypass"] = await self._bypass.open(*at.bypass)
        self.ports.update(self._can.open())
        if self._meters is not None:
            self._meters.plug_in()
            self._tasks.append(asyncio.create_task(self._meters.run()))
            self.ports["meters"] = str(at.meters)
        if at.control is not None:
            self.ports["control"] = await self._control.open(*at.control)

    async def run(self) -> None:
        """Serve until it is stopped, or until a part of it fails, which is raised.

        Without one of its devices it would be another rig, and nobody would know why.
        """
        while not self._stopped.is_set():
            self.tend()
            for task in (*self._tasks, *self._can.tasks):
                if task.done():
                    task.result()
            with suppress(TimeoutError):
                await asyncio.wait_for(self._stopped.wait(), _TEND_S)

    def tend(self) -> None:
        """Do what is due by the clock alone: watchdogs, buttons, faults, the plant itself."""
        self.plant.catch_up()
        self.node.tend()
        self.operator.tend()
        self._valve_path.tend()
        self._move_bypasses()
        if self.node.enabled:
            self.injection.valve_enabled()
        self.injection.tend()
        self._summarize()

    def _move_bypasses(self) -> None:
        """Let the plant leak as the bypass valves really stand."""
        positions = self._bypass.positions()
        for bypass, (ball, needle) in positions.items():
            if (ball, needle) != self._positions[bypass]:
                self.plant.set_bypass(bypass, ball, needle)
        self._positions = positions

    def _summarize(self) -> None:
        """Note the exchanges of the last second in the record."""
        now = self._clock()
        if now - self._summed_ns < _SUMMARY_NS:
            return
        new = self.node.exchanges - self._summed
        self._summed_ns, self._summed = now, self.node.exchanges
        if new:
            self.record.note("exchanges", now, new=new, **self.node.state())
        self.record.flush()

    def stop(self) -> None:
        """End `run` soon; to be called in the event loop's thread."""
        self._stopped.set()

    async def close(self) -> None:
        """Stop serving; harmless when repeated."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []
        await self._can.close()
        if self._meters is not None:
            self._meters.close()
        self._bypass.close()
        self._control.close()
        self._daq.close()

    def status(self) -> dict[str, Any]:
        """Return how every device stands, and the plant's true state, SI."""
        truth = self.plant.truth
        return {
            "time_ns": self.plant.time_ns,
            "daq": {"requests": self._daq.requests, **self.node.state()},
            "bypass": self._bypass.state(),
            "can": self._can.state(),
            "plant": {**truth._asdict(), **self.plant.coefficients},
            "faults": self.injection.state(),
        }

    def summary(self) -> dict[str, int]:
        """Return what happened since the start: exchanges, and events of the record by name."""
        events = Counter(event["event"] for event in self.record.events)
        return {"exchange": self.node.exchanges, **events}


def _plant(rig: Rig, seed: int, clock: Clock, pump_loaded: bool) -> EmulatedPlant:
    """Return the plant of a rig file, at rest at mid stroke."""
    fitted = np.ones(len(Reading._fields))
    for field, present in (
        ("spool", rig.has_spool_sensor),
        ("supply_pressure", rig.has_supply_pressure_sensor),
        ("load", rig.has_load_cell),
    ):
        if not present:
            fitted[Reading._fields.index(field)] = np.nan
    return EmulatedPlant(
        rig.plant,
        rig.sensors,
        bypass_valves=rig.bypass_valves,
        return_resistance=rig.return_valve.maximum if rig.return_valve else 0.0,
        fitted=fitted,
        pump_loaded=pump_loaded,
        seed=seed,
        clock=clock,
    )


def _bypass_io(rig: Rig, record: Record, clock: Clock) -> BypassIo:
    """Return the bypass valves of a rig, as slow as the slowest of its balls."""
    travels = [valve.ball_travel_s for valve in rig.bypass_valves.values()]
    return BypassIo(record, clock, *([max(travels)] if travels else []))


def _meter_panel(
    path: Path | None, flows: Callable[[], Sequence[float]], record: Record
) -> MeterPanel | None:
    return None if path is None else MeterPanel(path, flows, record)


def _io_device(
    register_map: RegisterMap | None,
    instruments: Instruments,
    valve: Callable[[float, int], None],
    record: Record,
) -> IoDevice:
    """Return the generic I/O node, or what else a map describes."""
    if register_map is None or register_map.identity.value == IDENTITY:
        return IoNode(instruments, valve, record)
    return MappedDevice(register_map, instruments, valve, record)
