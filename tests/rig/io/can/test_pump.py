"""The driver of the pump unit, on an emulated one described by the shipped DBC."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from rig.configuration.reading.lookup import shipped_config_dir
from rig.emulator.can.pump_node import PumpNode
from rig.emulator.record import Record
from rig.io.can.libraries import python_can as can
from rig.io.can.pump import CanPump, CanPumpOptions
from rig.io.driver import Driver, DriverError

DBC = shipped_config_dir() / "dbc" / "pump_unit.dbc"
FULL_PRESSURE = 13.8e6


class PumpBench:
    """A pump unit on a virtual bus; it and the driver share a clock that goes on when read."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.now = 100.0
        self.pressure = 0.0
        self.record = Record(clock=lambda: round(self.now * 1e9))
        self.bus = can.Bus(interface="virtual", channel=channel, ignore_config=True)
        self.pump = PumpNode(self.bus.send, DBC, lambda: self.pressure, self.load, self.record.note)
        self._drivers: list[CanPump] = []

    def load(self, loaded: bool) -> None:
        self.pressure = FULL_PRESSURE if loaded else 0.0

    def clock(self) -> float:
        self.now += 0.01
        while frame := self.bus.recv(0.0):
            self.pump.receive(frame)
        self.pump.cycle(self.now)
        return self.now

    def driver(self, **options: Any) -> CanPump:
        given = {"channel": self.channel, "dbc": DBC, **options}
        driver = CanPump("pump", CanPumpOptions(interface="virtual", **given), self.clock)
        self._drivers.append(driver)
        return driver

    def opened(self, **options: Any) -> CanPump:
        driver = self.driver(**options)
        driver.open()
        return driver

    def loaded(self, **options: Any) -> CanPump:
        driver = self.opened(**options)
        driver.write({"pump_load": 1.0})
        assert self.read(driver, 5)["pump_loaded"] == 1.0
        return driver

    def read(self, driver: CanPump, cycles: int = 1) -> dict[str, float]:
        """Read at 20 Hz; return the last values."""
        values: dict[str, float] = {}
        for _ in range(cycles):
            for _ in range(4):
                self.clock()
            values |= driver.read()
        return values

    def events(self) -> list[str]:
        return [event["event"] for event in self.record.events]

    def close(self) -> None:
        for driver in self._drivers:
            driver.close()
        self.bus.shutdown()


def broken(*_: Any, **__: Any) -> None:
    raise DriverError("pump", "bus is off", "check the cable")


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[PumpBench]:
    opened = PumpBench(request.node.nodeid)
    yield opened
    opened.close()


def test_it_is_a_slow_driver(bench: PumpBench) -> None:
    driver = bench.driver()
    assert isinstance(driver, Driver)
    assert driver.kind == "slow"


def test_opening_commands_nothing(bench: PumpBench) -> None:
    bench.read(bench.opened(), 10)
    assert bench.events() == []


def test_what_it_reads_is_in_si(bench: PumpBench) -> None:
    driver = bench.opened()
    bench.pressure = 6.9e6
    values = bench.read(driver, 3)
    assert values["pump_pressure_Pa"] == pytest.approx(6.9e6, abs=500.0)
    assert values["oil_temperature_K"] == pytest.approx(313.15, abs=0.05)
    assert values["pump_loaded"] == 0.0
    assert set(values) == set(driver.inputs)


def test_a_dbc_may_give_other_units(bench: PumpBench, tmp_path: Path) -> None:
    text = DBC.read_text().replace('"bar"', '"MPa"').replace("(0.01,0)", "(0.001,0)")
    given = tmp_path / "mine.dbc"
    given.write_text(text)
    bench.pump = PumpNode(bench.bus.send, given, lambda: 6.9e6, bench.load, bench.record.note)
    values = bench.read(bench.opened(dbc=given), 3)
    assert values["pump_pressure_Pa"] == pytest.approx(6.9e6, abs=500.0)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("PumpStatus", "Status", "lacks PumpStatus"),
        ("SG_ Loaded", "SG_ Laden", r"lacks PumpStatus\.Loaded"),
        ('"bar"', '"atm"', "gives Pressure in atm; use one of Pa, kPa, bar"),
        ('3 "FAULT"', '3 "BROKEN"', "has no value FAULT of MotorState"),
        ("BO_ ", "BO ", "cannot be read"),
    ],
)
def test_a_dbc_that_describes_no_pump_unit_is_refused(
    bench: PumpBench, tmp_path: Path, old: str, new: str, why: str
) -> None:
    given = tmp_path / "mine.dbc"
    # Comments may name a message twice over; they are not the matter here.
    lines = [line for line in DBC.read_text().splitlines() if not line.startswith("CM_")]
    given.write_text("\n".join(lines).replace(old, new) + "\n")
    with pytest.raises(DriverError, match=f"pump, dbc: .*{why}"):
        bench.driver(dbc=given)


def test_a_unit_that_is_not_heard_is_named_with_its_bus(bench: PumpBench) -> None:
    bench.pump.faults.silent = True
    with pytest.raises(DriverError, match=r"pump: no PumpStatus on virtual .*; check power"):
        bench.driver().open()


def test_it_loads_and_unloads(bench: PumpBench) -> None:
    driver = bench.loaded()
    assert bench.read(driver, 3)["pump_pressure_Pa"] == pytest.approx(FULL_PRESSURE, abs=500.0)
    driver.write({"pump_load": 0.0})
    assert bench.read(driver, 5)["pump_loaded"] == 0.0
    assert bench.events() == ["pump_command", "pump_loaded", "pump_command", "pump_unloaded"]


def test_it_stays_loaded_as_long_as_its_driver_reads(bench: PumpBench) -> None:
    driver = bench.loaded()
    assert bench.read(driver, 200)["pump_loaded"] == 1.0


def test_it_unloads_when_its_host_falls_silent(bench: PumpBench) -> None:
    bench.loaded()
    for _ in range(200):
        bench.clock()
    assert not bench.pump.loaded
    assert bench.events()[-2:] == ["pump_watchdog", "pump_unloaded"]


def test_a_unit_whose_watchdog_is_dead_stays_loaded_when_its_host_falls_silent(
    bench: PumpBench,
) -> None:
    bench.loaded()
    bench.pump.faults.watchdog_dead = True
    for _ in range(200):
        bench.clock()
    assert bench.pump.loaded
    bench.pump.faults.watchdog_dead = False
    bench.clock()
    assert not bench.pump.loaded


@pytest.mark.parametrize("outputs", [{"pump_load": 0.5}, {"pump_speed": 1.0}])
def test_what_cannot_be_is_refused(bench: PumpBench, outputs: dict[str, float]) -> None:
    driver = bench.opened()
    with pytest.raises(DriverError):
        driver.write(outputs)
    bench.read(driver, 3)
    assert bench.events() == []


@pytest.mark.parametrize("fault", ["silent", "frozen"])
def test_a_lost_or_frozen_unit_is_reported_by_its_alive_counter(
    bench: PumpBench, fault: str
) -> None:
    driver = bench.loaded()
    setattr(bench.pump.faults, fault, True)
    with pytest.raises(DriverError, match=r"alive counter stands at \d+ for 0\.5\d s"):
        bench.read(driver, 50)
    setattr(bench.pump.faults, fault, False)
    assert bench.read(driver, 3)["pump_loaded"] == 1.0


def test_a_motor_fault_is_reported(bench: PumpBench) -> None:
    driver = bench.loaded()
    bench.pump.faults.motor_fault = True
    with pytest.raises(DriverError, match="its motor reports a fault"):
        bench.read(driver, 3)


def test_a_stuck_unloading_valve_is_reported(bench: PumpBench) -> None:
    driver = bench.opened(load_timeout=1.0)
    bench.pump.faults.stuck = True
    driver.write({"pump_load": 1.0})
    bench.read(driver, 3)
    with pytest.raises(DriverError, match="is unloaded, loaded wanted for 1 s"):
        bench.read(driver, 100)


def test_garbage_is_passed_over(bench: PumpBench) -> None:
    driver = bench.loaded()
    bench.pump.faults.garbage = True
    assert bench.read(driver, 20)["pump_loaded"] == 1.0


def test_other_traffic_is_not_taken_for_the_units(bench: PumpBench) -> None:
    driver = bench.opened()
    for identifier, extended in ((0x18FF1022, True), (0x185, False)):
        frame = can.Message(arbitration_id=identifier, data=b"\xff" * 8, is_extended_id=extended)
        bench.bus.send(frame)
    values = driver.read()
    assert values.get("pump_loaded", 0.0) == 0.0
    bench.read(driver, 5)


def test_the_safe_state_is_unloaded_and_confirmed(bench: PumpBench) -> None:
    driver = bench.loaded()
    driver.safe_state()
    assert not bench.pump.loaded
    driver.safe_state()
    assert bench.read(driver, 3)["pump_loaded"] == 0.0


def test_it_can_be_loaded_again_after_a_trip(bench: PumpBench) -> None:
    driver = bench.loaded()
    driver.safe_state()
    driver.write({"pump_load": 1.0})
    assert bench.read(driver, 5)["pump_loaded"] == 1.0


def test_the_safe_state_needs_no_open_driver(bench: PumpBench) -> None:
    bench.loaded()
    bench.driver().safe_state()
    assert not bench.pump.loaded


def test_the_safe_state_needs_no_sound_connection(
    bench: PumpBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = bench.loaded()
    monkeypatch.setattr(driver._link, "send", broken)
    with pytest.raises(DriverError, match="bus is off"):
        driver.read()
    driver.safe_state()
    assert not bench.pump.loaded


@pytest.mark.parametrize("fault", ["stuck", "silent", "frozen"])
def test_an_unconfirmed_safe_state_is_reported(bench: PumpBench, fault: str) -> None:
    driver = bench.loaded(load_timeout=0.5)
    setattr(bench.pump.faults, fault, True)
    with pytest.raises(DriverError, match=r"unloading not confirmed in 0\.5 s; switch"):
        driver.safe_state()


def test_a_driver_that_is_not_open_says_so(bench: PumpBench) -> None:
    with pytest.raises(DriverError, match="pump: is not open; open it first"):
        bench.driver().read()


@pytest.mark.parametrize(
    ("turn", "step"), [("read", "_listen"), ("write", "_ask"), ("read", "_encoded")]
)
def test_a_turn_that_was_stopped_does_not_load_a_pump_that_was_unloaded_meanwhile(
    bench: PumpBench, monkeypatch: pytest.MonkeyPatch, turn: str, step: str
) -> None:
    driver = bench.loaded(load_timeout=10.0)
    take_step = getattr(driver, step)

    def stopped(*given: Any) -> Any:
        """Be stopped for 1.7 s before a step of the turn that comes before the command is sent."""
        bench.now += 1.7
        bench.clock()
        return take_step(*given)

    with monkeypatch.context() as patched:
        patched.setattr(driver, step, stopped)
        # Where the status was heard before the stop, the unit counts as lost, which is an error.
        with suppress(DriverError):
            if turn == "read":
                driver.read()
            else:
                driver.write({"pump_load": 1.0})
    bench.clock()
    assert not bench.pump.loaded
    assert bench.events()[-2:] == ["pump_watchdog", "pump_unloaded"]
    # The caller looks for a trip before the next turn, which commands again.
    assert bench.read(driver, 3)["pump_loaded"] == 1.0
