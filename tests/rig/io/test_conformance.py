"""Every driver that ships, and a few that do not behave, through the conformance suite."""

import itertools
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from rig.channels import BYPASSES
from rig.configuration.reading.document import Sources
from rig.configuration.reading.lookup import shipped_config_dir
from rig.configuration.rigs.register_maps import read_map
from rig.emulator.instruments import Instruments
from rig.emulator.meters import MeterPanel
from rig.emulator.modbus.io_node import IoNode
from rig.emulator.modbus.server import ModbusServer
from rig.emulator.plant import EmulatedPlant
from rig.emulator.record import Record
from rig.io.can.ds408 import DriveState
from rig.io.conformance import (
    CHECKS,
    Check,
    NonconformityError,
    Specimen,
    check_declaration,
    check_exchange,
    check_lost_exchange,
)
from rig.io.driver import DriverError
from rig.io.flow_meters.driver import FlowMeterOptions, FlowMeters
from rig.io.modbus_daq.driver import ModbusDaq
from rig.io.modbus_daq.link import ModbusDaqOptions
from rig.io.modbus_daq.register_map import RegisterMap
from rig.io.registry import driver_types
from rig.plant import Model
from tests.rig.io.can.test_pump import PumpBench
from tests.rig.io.can.test_valve import ValveBench
from tests.rig.io.conftest import BypassBench, DeviceThread, ManualClock
from tests.rig.io.datagram_daq import DatagramDaq, DatagramOptions, DatagramPlan
from tests.rig.io.datagram_device import DatagramDevice
from tests.waiting import PATIENCE_S

Specimens = Callable[[Path], AbstractContextManager[Specimen]]

_channels = (f"conformance-{i}" for i in itertools.count())


@contextmanager
def _bypass_specimen(folder: Path, *, serial: bool) -> Iterator[Specimen]:
    thread = DeviceThread()
    bench = BypassBench(thread, folder)

    def is_safe() -> bool:
        positions = bench.device.valves.positions()
        shut = all(positions[bypass][0] == 0.0 for bypass in BYPASSES[:-1])
        return shut and positions["return_blockage"][1] <= 0.02

    moves = {
        "supply_leakage_ball": 1.0,
        "supply_leakage_needle": 0.4,
        "return_blockage_needle": 0.3,
    }
    driver = bench.serial_driver(baud=115_200) if serial else bench.driver()
    try:
        yield Specimen(
            driver,
            bench.power_off,
            bench.device.valves.positions,
            is_safe,
            moves,
            bench.clock.advance,
        )
    finally:
        bench.end()
        thread.end()


def bypass_over_tcp(folder: Path) -> AbstractContextManager[Specimen]:
    return _bypass_specimen(folder, serial=False)


def bypass_over_a_serial_line(folder: Path) -> AbstractContextManager[Specimen]:
    return _bypass_specimen(folder, serial=True)


@contextmanager
def flow_meters(folder: Path) -> Iterator[Specimen]:
    clock = ManualClock()
    panel = MeterPanel(folder / "tty", lambda: (1e-5, 2e-5, 3e-5), Record(clock=clock))
    panel.plug_in()

    def wait(time_s: float) -> None:
        clock.advance(time_s)
        panel.send()

    driver = FlowMeters("meters", FlowMeterOptions(str(folder / "tty")), clock, wait)
    try:
        yield Specimen(driver, panel.close, wait=wait)
    finally:
        driver.close()
        panel.close()


@contextmanager
def can_valve(_: Path) -> Iterator[Specimen]:
    bench = ValveBench(next(_channels))

    def unplug() -> None:
        bench.valve.faults.silent = True

    def is_safe() -> bool:
        return bench.valve.state in (DriveState.INIT, DriveState.DISABLED)

    def wait(_: float) -> None:
        for _ in range(5):
            bench.clock()

    moves = {"drive_target": DriveState.ACTIVE}
    try:
        driver = bench.driver(open_timeout=0.5, step_timeout=0.3)
        yield Specimen(driver, unplug, lambda: bench.valve.state, is_safe, moves, wait)
    finally:
        bench.close()


@contextmanager
def can_pump(_: Path) -> Iterator[Specimen]:
    bench = PumpBench(next(_channels))

    def unplug() -> None:
        bench.pump.faults.silent = True

    def is_safe() -> bool:
        return bench.pressure == 0.0

    def wait(_: float) -> None:
        for _ in range(5):
            bench.clock()

    moves = {"pump_load": 1.0}
    try:
        yield Specimen(bench.driver(), unplug, lambda: bench.pressure, is_safe, moves, wait)
    finally:
        bench.close()


@contextmanager
def modbus_daq(_: Path) -> Iterator[Specimen]:
    thread, clock = DeviceThread(), ManualClock()
    record = Record(clock=clock)
    plant = EmulatedPlant(Model(), clock=clock)
    node = IoNode(Instruments(plant), plant.drive_valve, record)
    server = ModbusServer("daq", node, record)
    port = thread.run(server.open("127.0.0.1", 0))

    def output() -> tuple[object, object]:
        state = node.state()
        return state["output_V"], state["valve_enabled"]

    def press_reset(time_s: float) -> None:
        def press() -> None:
            clock.advance(time_s)
            node.press_reset(True)
            node.press_reset(False)

        thread.call(press)

    path = shipped_config_dir() / "maps" / "io_node.yaml"
    root = Sources().read_yaml(path)
    assert root is not None
    register_map = read_map(root)
    assert isinstance(register_map, RegisterMap)
    options = ModbusDaqOptions("127.0.0.1", register_map, port, watchdog=0.1, timeout=PATIENCE_S)
    driver = ModbusDaq("daq", options)

    def unplug() -> None:
        thread.close(server.close)

    def is_safe() -> bool:
        return output() == (0.0, False)

    moves = {"command_V": 1.0, "valve_enable": 1.0, "reset_lamp": 1.0}
    try:
        yield Specimen(driver, unplug, output, is_safe, moves, press_reset)
    finally:
        driver.close()
        unplug()
        thread.end()


@contextmanager
def datagram_daq(_: Path, driver_class: type[DatagramDaq] = DatagramDaq) -> Iterator[Specimen]:
    with DatagramDevice() as device:
        driver = driver_class("daq", DatagramOptions(device.port, timeout=PATIENCE_S))
        try:
            yield Specimen(
                driver,
                device.close,
                lambda: (device.output_V, device.enabled),
                lambda: device.is_null,
                {"command_V": 1.0, "valve_enable": 1.0},
            )
        finally:
            driver.close()


SHIPPED: Mapping[str, tuple[Specimens, ...]] = {
    "bypass_valves": (bypass_over_tcp, bypass_over_a_serial_line),
    "can_pump": (can_pump,),
    "can_valve": (can_valve,),
    "flow_meters": (flow_meters,),
    "modbus_daq": (modbus_daq,),
}

ALL = [*(specimens for given in SHIPPED.values() for specimens in given), datagram_daq]


def named(value: Any) -> str:
    return str(value.__name__)


def test_every_driver_that_ships_is_among_those_checked() -> None:
    assert set(driver_types()) == set(SHIPPED)


@pytest.mark.parametrize("check", CHECKS, ids=named)
@pytest.mark.parametrize("specimens", ALL, ids=named)
def test_every_driver_that_ships_and_one_from_elsewhere_conforms(
    specimens: Specimens, check: Check, tmp_path: Path
) -> None:
    check(lambda: specimens(tmp_path))


class Obedient:
    """A pump without a bus, that does all it should; those below each miss one thing."""

    kind = "slow"
    Options = FlowMeterOptions

    def __init__(self) -> None:
        self.name = "pump"
        self.inputs: tuple[str, ...] = ("pump_loaded",)
        self.outputs: tuple[str, ...] = ("pump_load",)
        self.rate_hz = 20.0
        self.there, self.is_open, self.loaded = True, False, 0.0

    def reach(self) -> None:
        if not self.there:
            raise DriverError(self.name, "is lost", "check the cable")

    def reach_open(self) -> None:
        self.reach()
        if not self.is_open:
            raise DriverError(self.name, "is not open", "open it")

    def open(self) -> None:
        self.reach()
        self.is_open = True

    def read(self) -> Mapping[str, Any]:
        self.reach_open()
        return {"pump_loaded": self.loaded}

    def write(self, outputs: Mapping[str, float]) -> None:
        for signal, value in outputs.items():
            if signal != "pump_load" or value not in (0.0, 1.0):
                raise DriverError(self.name, f"cannot be {value}", "write 0 or 1", signal)
        self.reach_open()
        self.loaded = outputs.get("pump_load", self.loaded)

    def safe_state(self) -> None:
        self.reach()
        self.loaded = 0.0

    def close(self) -> None:
        self.is_open = False


class UndeclaredSignal(Obedient):
    def __init__(self) -> None:
        super().__init__()
        self.inputs = ("pump_loaded", "coffee_level")


class ReadsWhatItDoesNotDeclare(Obedient):
    def read(self) -> Mapping[str, Any]:
        return {**super().read(), "pump_pressure_Pa": 1.0}


class ReadsText(Obedient):
    def read(self) -> Mapping[str, Any]:
        return {"pump_loaded": str(super().read()["pump_loaded"])}


class ReadsNothing(Obedient):
    def read(self) -> Mapping[str, Any]:
        self.reach_open()
        return {}


class MovesWhenOpened(Obedient):
    def open(self) -> None:
        super().open()
        self.loaded = 1.0


class OpensOnce(Obedient):
    def close(self) -> None:
        if not self.is_open:
            raise ValueError("not open")
        super().close()


class ReadsUnopened(Obedient):
    def reach_open(self) -> None:
        self.reach()


class TakesAnything(Obedient):
    def write(self, outputs: Mapping[str, float]) -> None:
        self.reach_open()
        self.loaded = outputs.get("pump_load", self.loaded)


class RefusesNamelessly(Obedient):
    def write(self, outputs: Mapping[str, float]) -> None:
        try:
            super().write(outputs)
        except DriverError as error:
            raise DriverError(self.name, error.state, error.action) from error


class StaysLoaded(Obedient):
    def safe_state(self) -> None:
        self.reach()


class SafeWithoutItsDevice(Obedient):
    def safe_state(self) -> None:
        self.loaded = 0.0


class RaisesSomethingElse(Obedient):
    def reach(self) -> None:
        if not self.there:
            raise OSError("no such device")


class BlamesAnother(Obedient):
    def reach(self) -> None:
        if not self.there:
            raise DriverError("somebody", "is lost", "check the cable")


class DoesNotNotice(Obedient):
    def read(self) -> Mapping[str, Any]:
        return {"pump_loaded": self.loaded}


def failures(driver_class: type[Obedient]) -> dict[str, str]:
    """Return what the suite raises, by the check that does."""

    @contextmanager
    def specimen() -> Iterator[Specimen]:
        driver = driver_class()

        def unplug() -> None:
            driver.there = False

        yield Specimen(
            driver,  # type: ignore[arg-type]
            unplug,
            lambda: driver.loaded,
            lambda: driver.loaded == 0.0,
            {"pump_load": 1.0},
            lambda _: None,
        )

    found = {}
    for check in CHECKS:
        try:
            check(specimen)
        except Exception as error:
            found[named(check)] = str(error)
    return found


def test_a_driver_that_does_all_it_should_conforms() -> None:
    assert failures(Obedient) == {}


@pytest.mark.parametrize(
    ("driver_class", "check", "what"),
    [
        (UndeclaredSignal, "check_declaration", "has inputs that no slow driver has: ['coffee_"),
        (ReadsWhatItDoesNotDeclare, "check_readings", "reads pump_pressure_Pa, which it does not"),
        (ReadsText, "check_readings", "reads pump_loaded as str"),
        (ReadsNothing, "check_readings", "never reads pump_loaded"),
        (MovesWhenOpened, "check_open_moves_nothing", "moves something before the first write"),
        (OpensOnce, "check_open_and_close", "not open"),
        (ReadsUnopened, "check_not_open", "reads before it is open"),
        (TakesAnything, "check_bad_outputs", "writes no_such_signal = 1.0"),
        (RefusesNamelessly, "check_bad_outputs", "refuses no_such_signal = 1.0 without naming it"),
        (StaysLoaded, "check_safe_state", "is not safe after safe_state after a move"),
        (SafeWithoutItsDevice, "check_vanished_device", "calls itself safe without its device"),
        (RaisesSomethingElse, "check_absent_device", "raises OSError, no DriverError"),
        (BlamesAnother, "check_absent_device", "calls itself 'somebody'"),
        (DoesNotNotice, "check_vanished_device", "does not notice that its device is gone"),
    ],
)
def test_what_a_driver_does_wrong_is_named(
    driver_class: type[Obedient], check: str, what: str
) -> None:
    assert what in failures(driver_class)[check]


class WritesByALook(DatagramDaq):
    def look_plan(self) -> DatagramPlan:
        return self.plan()


class WritesNothing(DatagramDaq):
    def plan(self) -> DatagramPlan:
        return self.look_plan()


class SeesNothingDriven(DatagramDaq):
    def driven(self) -> str:
        super().driven()
        return ""


class DrivenWithoutItsDevice(DatagramDaq):
    def driven(self) -> str:
        return "who knows"


class HidesAnInput(DatagramDaq):
    def __init__(self, name: str, options: DatagramOptions) -> None:
        super().__init__(name, options)
        self.inputs = self.inputs[1:]


class NotCompiledPlan(NamedTuple):
    request: Any

    def exchange(self, *_: Any) -> tuple[int, int]:
        return 0, 0


class NotCompiled(DatagramDaq):
    def plan(self) -> Any:
        return NotCompiledPlan(0)

    look_plan = plan


class Nameless(DatagramDaq):
    fileno: Any = None


@pytest.mark.parametrize(
    ("driver_class", "check", "what"),
    [
        (WritesByALook, check_exchange, "moves something by its look plan"),
        (WritesNothing, check_exchange, "writes nothing by its plan"),
        (SeesNothingDriven, check_exchange, "calls what it drives null"),
        (DrivenWithoutItsDevice, check_lost_exchange, "calls its valve null without its device"),
        (HidesAnInput, check_exchange, "exchanges ['position_m'], which it does not declare"),
        (NotCompiled, check_exchange, "exchange cannot be compiled"),
        (Nameless, check_declaration, "lacks part of the protocol rig.io.driver.FastDriver"),
    ],
)
def test_what_a_fast_driver_does_wrong_is_named(
    driver_class: type[DatagramDaq], check: Check, what: str, tmp_path: Path
) -> None:
    with pytest.raises(NonconformityError, match=re.escape(what)):
        check(lambda: datagram_daq(tmp_path, driver_class))


def test_a_call_that_hangs_is_a_failure_and_does_not_hang_the_suite(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    released = threading.Event()

    class Hangs(Obedient):
        def safe_state(self) -> None:
            released.wait()

    monkeypatch.setattr("rig.io.conformance.PATIENCE_S", 0.01)
    try:
        assert "takes more than 0.01 s" in failures(Hangs)["check_vanished_device"]
    finally:
        released.set()
