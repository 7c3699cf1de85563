"""The driver of the digital servovalve, on an emulated valve."""

from collections.abc import Iterator
from typing import Any

import pytest

from rig.emulator.can.valve_node import ValveNode
from rig.emulator.record import Record
from rig.io.can.canopen import DEVICE_TYPE, HEARTBEAT, TPDO1, read_request
from rig.io.can.ds408 import WALK, DriveState
from rig.io.can.ds408_valve import CanValveOptions, Ds408Valve
from rig.io.can.libraries import python_can as can
from rig.io.can.valve import CanValve
from rig.io.driver import Driver, DriverError

NODE = 5
FULL_STROKE = 2.5e-4
ACTIVE_WALK = ["DISABLED", "HOLD", "ACTIVE"]


class ValveBench:
    """A valve on a virtual bus; it and the driver share a clock that goes on when it is read."""

    def __init__(self, channel: str) -> None:
        self.channel = channel
        self.now = 100.0
        self.spool = 0.0
        self.record = Record(clock=lambda: round(self.now * 1e9))
        self.bus = can.Bus(interface="virtual", channel=channel, ignore_config=True)
        self.valve = ValveNode(
            self.bus.send, lambda: self.spool, FULL_STROKE, NODE, self.record.note
        )
        self._drivers: list[CanValve] = []

    def clock(self) -> float:
        self.now += 0.01
        while frame := self.bus.recv(0.0):
            self.valve.receive(frame)
        self.valve.cycle(self.now)
        return self.now

    def driver(self, **options: Any) -> CanValve:
        given = {"channel": self.channel, "node": NODE, "full_stroke": FULL_STROKE, **options}
        driver = CanValve("drive", CanValveOptions(interface="virtual", **given), self.clock)
        self._drivers.append(driver)
        return driver

    def opened(self, **options: Any) -> CanValve:
        driver = self.driver(**options)
        driver.open()
        return driver

    def active(self, **options: Any) -> CanValve:
        driver = self.opened(**options)
        driver.write({"drive_target": DriveState.ACTIVE})
        self.read_until(driver, DriveState.ACTIVE)
        return driver

    def read(self, driver: CanValve, cycles: int = 1) -> dict[str, float]:
        """Read at 20 Hz; return the last values."""
        values: dict[str, float] = {}
        for _ in range(cycles):
            for _ in range(4):
                self.clock()
            values |= driver.read()
        return values

    def read_until(self, driver: CanValve, state: DriveState) -> None:
        for _ in range(50):
            if self.read(driver).get("drive_state") == state:
                return
        raise AssertionError(f"stands in {self.valve.state.name}, not in {state.name}")

    def passed(self) -> list[str]:
        return [event["state"] for event in self.record.events if event["event"] == "drive_state"]

    def close(self) -> None:
        for driver in self._drivers:
            driver.close()
        self.bus.shutdown()


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[ValveBench]:
    opened = ValveBench(request.node.nodeid)
    yield opened
    opened.close()


def silent_for(bench: ValveBench, time_s: float) -> None:
    until = bench.now + time_s
    while bench.clock() < until:
        pass


def test_it_is_a_slow_driver(bench: ValveBench) -> None:
    driver = bench.driver()
    assert isinstance(driver, Driver)
    assert driver.kind == "slow"


def test_opening_moves_nothing(bench: ValveBench) -> None:
    driver = bench.opened()
    bench.read(driver, 5)
    assert bench.passed() == []
    assert bench.valve.state is DriveState.INIT


def test_it_says_what_it_reads(bench: ValveBench) -> None:
    driver = bench.opened()
    bench.spool = -0.5 * FULL_STROKE
    values = bench.read(driver, 2)
    assert values["drive_state"] == DriveState.INIT
    assert values["drive_spool_m"] == pytest.approx(-0.5 * FULL_STROKE, abs=1e-4 * FULL_STROKE)
    assert set(values) == set(driver.inputs)


def test_nothing_is_read_twice(bench: ValveBench) -> None:
    driver = bench.opened()
    bench.read(driver)
    bench.valve.faults.silent = True
    driver.read()
    assert driver.read() == {}


def test_a_node_that_is_not_there_is_named_with_its_bus(bench: ValveBench) -> None:
    bench.valve.faults.silent = True
    with pytest.raises(DriverError, match=r"drive: node 5 is not heard on virtual .*; check power"):
        bench.driver(open_timeout=0.5).open()


def test_a_device_of_another_profile_is_refused(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    reply = bytes.fromhex("4300100092010200")  # 0x00020192: drive, profile 402

    def receive(frame: can.Message) -> None:
        if bytes(frame.data) == read_request(DEVICE_TYPE):
            bench.bus.send(can.Message(arbitration_id=0x585, data=reply, is_extended_id=False))

    monkeypatch.setattr(bench.valve, "receive", receive)
    with pytest.raises(DriverError, match="device of profile 402, not 408"):
        bench.driver().open()


def test_a_valve_that_is_active_already_is_refused(bench: ValveBench) -> None:
    bench.valve.state = DriveState.ACTIVE
    bench.valve.faults.stuck = True
    with pytest.raises(DriverError, match="is ACTIVE already"):
        bench.driver().open()


def test_it_walks_to_active_one_confirmed_state_at_a_time(bench: ValveBench) -> None:
    bench.active()
    assert bench.passed() == ACTIVE_WALK
    words = [event["word"] for event in bench.record.events if event["event"] == "drive_command"]
    assert words == [0b001, 0b011, 0b111]


@pytest.mark.parametrize("target", WALK)
def test_it_walks_back_from_active(bench: ValveBench, target: DriveState) -> None:
    driver = bench.active()
    driver.write({"drive_target": float(target)})
    bench.read_until(driver, target)
    down = ["HOLD", "DISABLED", "INIT"]
    assert bench.passed() == ACTIVE_WALK + down[: WALK[::-1].index(target)]


def test_a_write_does_not_wait_for_the_valve(bench: ValveBench) -> None:
    bench.valve.faults.stuck = True
    driver = bench.opened()
    driver.write({"drive_target": DriveState.HOLD})
    assert bench.read(driver)["drive_state"] == DriveState.INIT


def test_a_step_not_taken_names_the_state_reached_and_the_one_wanted(bench: ValveBench) -> None:
    driver = bench.opened()
    driver.write({"drive_target": DriveState.DISABLED})
    bench.read_until(driver, DriveState.DISABLED)
    bench.valve.faults.stuck = True
    driver.write({"drive_target": DriveState.ACTIVE})
    with pytest.raises(DriverError, match="stands in DISABLED, HOLD wanted on the way to ACTIVE"):
        bench.read(driver, 50)
    bench.read(driver, 5)


def test_a_state_left_by_itself_is_reported_and_not_walked_back_to(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.state = DriveState.HOLD
    bench.valve.faults.stuck = True
    with pytest.raises(DriverError, match="left ACTIVE for HOLD by itself"):
        bench.read(driver, 3)
    bench.valve.faults.stuck = False
    bench.read(driver, 10)
    assert bench.valve.state is DriveState.HOLD


def test_the_analog_input_acts_when_it_is_the_source(bench: ValveBench) -> None:
    driver = bench.opened()
    assert bench.valve.acting_command(0.3) == 0.0
    driver.write({"drive_target": DriveState.ACTIVE})
    bench.read_until(driver, DriveState.ACTIVE)
    assert bench.valve.acting_command(0.3) == 0.3
    assert driver.outputs == ("drive_target",)


def test_a_setpoint_by_the_bus_acts_only_once_the_valve_is_active(bench: ValveBench) -> None:
    driver = bench.opened(setpoint="bus")
    driver.write({"drive_target": DriveState.ACTIVE, "drive_setpoint": 0.25})
    sent = [bench.read(driver, 2)["drive_setpoint"] for _ in range(10)]
    assert sent[0] == 0.0
    assert sent[-1] == 0.25
    assert bench.valve.acting_command(0.9) == pytest.approx(0.25, abs=1e-4)
    early = [
        event
        for event in bench.record.events
        if event["event"] == "drive_command" and event["word"] != 0b111
    ]
    assert all(event["setpoint"] == 0.0 for event in early)


@pytest.mark.parametrize(
    ("outputs", "why"),
    [
        ({"drive_target": float(DriveState.FAULT_HOLD)}, "3 is no state to ask for"),
        ({"drive_target": float("nan")}, "nan is no state to ask for"),
        ({"drive_setpoint": 1.01}, "1.01 is not between -1 and 1"),
        ({"pump_load": 1.0}, "is not an output of this valve"),
    ],
)
def test_what_cannot_be_is_refused(bench: ValveBench, outputs: dict[str, float], why: str) -> None:
    driver = bench.opened(setpoint="bus")
    with pytest.raises(DriverError, match=why):
        driver.write({"drive_target": DriveState.DISABLED, **outputs})
    bench.read(driver, 3)
    assert bench.passed() == []


def test_the_setpoint_of_a_refused_target_never_acts(bench: ValveBench) -> None:
    driver = bench.active(setpoint="bus")
    driver._connected().state = DriveState.FAULT_REACTION
    with pytest.raises(DriverError, match="is in FAULT_REACTION; wait until it has ended"):
        driver.write({"drive_target": DriveState.ACTIVE, "drive_setpoint": 0.5})
    bench.read(driver)
    driver.write({"drive_target": DriveState.ACTIVE})
    bench.read_until(driver, DriveState.ACTIVE)
    assert bench.read(driver)["drive_setpoint"] == 0.0
    assert bench.valve.acting_command(0.0) == 0.0


def test_a_fault_is_reported_once_with_its_emergency_in_words(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.fail(0x4210)
    with pytest.raises(DriverError, match="emergency 0x4210, device temperature"):
        bench.read(driver)
    assert bench.read(driver)["drive_state"] == DriveState.FAULT_HOLD


def test_a_fault_ends_the_walk_for_good(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.fail(0x4210)
    with pytest.raises(DriverError):
        bench.read(driver)
    bench.read(driver, 20)
    assert bench.valve.state is DriveState.FAULT_HOLD


@pytest.mark.parametrize("at", WALK)
def test_a_target_asked_for_in_a_fault_resets_it(bench: ValveBench, at: DriveState) -> None:
    driver = bench.opened()
    driver.write({"drive_target": at})
    bench.read_until(driver, at)
    bench.valve.fail(0x4210)
    with pytest.raises(DriverError):
        bench.read(driver)
    driver.write({"drive_target": DriveState.ACTIVE})
    bench.read_until(driver, DriveState.ACTIVE)


def test_a_lost_heartbeat_is_reported_as_long_as_it_is_lost(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.faults.heartbeat_lost = True
    with pytest.raises(DriverError, match=r"node 5 is lost: no heartbeat for 0\.5"):
        bench.read(driver, 50)
    with pytest.raises(DriverError, match="node 5 is lost: no heartbeat"):
        driver.read()
    bench.valve.faults.heartbeat_lost = False
    silent_for(bench, 0.2)
    assert bench.read(driver, 3)["drive_state"] == DriveState.ACTIVE


def test_lost_status_messages_are_reported(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = bench.active()

    def heartbeat_only(frame: can.Message) -> None:
        if frame.arbitration_id == HEARTBEAT + NODE:
            bench.bus.send(frame)

    monkeypatch.setattr(bench.valve, "_send_frame", heartbeat_only)
    with pytest.raises(DriverError, match=r"node 5 is lost: no status for 0\.5"):
        bench.read(driver, 50)


def test_garbage_on_the_bus_is_passed_over(bench: ValveBench) -> None:
    bench.valve.faults.garbage = True
    driver = bench.active()
    bench.bus.send(can.Message(arbitration_id=TPDO1 + NODE, data=b"\xff", is_extended_id=False))
    assert bench.read(driver, 5)["drive_state"] == DriveState.ACTIVE


def test_other_traffic_does_not_hide_the_valve(bench: ValveBench) -> None:
    driver = bench.active()
    for _ in range(30):
        for identifier in range(0x300, 0x320):
            bench.bus.send(can.Message(arbitration_id=identifier, data=b"", is_extended_id=False))
        values = bench.read(driver)
    assert values["drive_state"] == DriveState.ACTIVE


def test_a_valve_whose_host_falls_silent_leaves_active_by_itself(bench: ValveBench) -> None:
    bench.active(watchdog=0.5)
    silent_for(bench, 1.0)
    assert bench.valve.state is DriveState.FAULT_HOLD
    assert bench.valve.acting_command(0.7) == 0.0


def test_the_safe_state_is_disabled_with_setpoint_zero_and_confirmed(bench: ValveBench) -> None:
    driver = bench.active(setpoint="bus")
    driver.write({"drive_setpoint": 0.5})
    bench.read(driver)
    driver.safe_state()
    assert bench.valve.state is DriveState.DISABLED
    assert bench.valve.acting_command(0.0) == 0.0
    driver.safe_state()
    bench.read(driver, 3)
    assert bench.valve.state is DriveState.DISABLED


def test_it_can_be_active_again_after_a_trip(bench: ValveBench) -> None:
    driver = bench.active()
    driver.safe_state()
    driver.write({"drive_target": DriveState.ACTIVE})
    bench.read_until(driver, DriveState.ACTIVE)


def test_the_safe_state_needs_no_open_driver(bench: ValveBench) -> None:
    bench.active()
    driver = bench.driver()
    driver.safe_state()
    assert bench.valve.state is DriveState.DISABLED
    with pytest.raises(DriverError, match="is not open"):
        driver.read()
    driver.open()
    bench.read(driver)


def test_the_safe_state_needs_no_sound_connection(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = bench.active()

    def broken(*_: Any) -> None:
        raise DriverError("drive", "bus is off", "check the cable")

    monkeypatch.setattr(driver._valve, "command", broken)
    with pytest.raises(DriverError, match="bus is off"):
        driver.read()
    driver.safe_state()
    assert bench.valve.state is DriveState.DISABLED
    assert bench.read(driver)["drive_state"] == DriveState.DISABLED


@pytest.mark.parametrize("is_open", [False, True])
def test_the_safe_state_is_tried_again_while_the_bus_cannot_be_opened(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch, *, is_open: bool
) -> None:
    driver = bench.active()
    if is_open:
        driver._connected().close()
    else:
        driver = bench.driver()
    failures = 3

    def fails_at_first(*arguments: Any) -> Ds408Valve:
        nonlocal failures
        failures -= 1
        if failures >= 0:
            raise DriverError("drive", "cannot open the bus", "bring it up")
        return Ds408Valve(*arguments)

    monkeypatch.setattr("rig.io.can.valve.Ds408Valve", fails_at_first)
    driver.safe_state()
    assert failures < 0
    assert bench.valve.state is DriveState.DISABLED


def test_a_safe_state_without_a_bus_is_reported_and_an_open_driver_stays_open(
    bench: ValveBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    driver = bench.active()
    driver._connected().close()

    def fails(*_: Any) -> None:
        raise DriverError("drive", "cannot open the bus", "bring it up")

    with monkeypatch.context() as patch:
        patch.setattr("rig.io.can.valve.Ds408Valve", fails)
        with pytest.raises(DriverError, match=r"not confirmed in 1 s: cannot open the bus; take"):
            driver.safe_state()
    driver.safe_state()
    assert bench.valve.state is DriveState.DISABLED
    assert bench.read(driver)["drive_state"] == DriveState.DISABLED


def test_a_bus_that_is_not_there_is_named_with_how_to_bring_it_up() -> None:
    driver = CanValve("drive", CanValveOptions(interface="socketcan", channel="nosuchcan"))
    why = "drive: cannot open socketcan nosuchcan: .*; .*ip link set nosuchcan up type can bitrate"
    with pytest.raises(DriverError, match=why):
        driver.open()


def test_the_safe_state_of_a_fault_leaves_the_fault(bench: ValveBench) -> None:
    driver = bench.active()
    bench.valve.fail(0x3100)
    driver.safe_state()
    assert bench.valve.state is DriveState.FAULT_DISABLED


@pytest.mark.parametrize(("fault", "why"), [("stuck", "ACTIVE"), ("silent", "no answer")])
def test_an_unconfirmed_safe_state_is_reported(bench: ValveBench, fault: str, why: str) -> None:
    driver = bench.active()
    setattr(bench.valve.faults, fault, True)
    with pytest.raises(DriverError, match=f"DISABLED not confirmed in 1 s: .*{why}.*; take the"):
        driver.safe_state()


def test_the_watchdog_is_armed_with_the_first_target_and_again_after_a_trip(
    bench: ValveBench,
) -> None:
    driver = bench.opened(watchdog=0.5)
    bench.read(driver)
    silent_for(bench, 2.0)
    assert bench.passed() == []
    for _ in range(2):
        bench.read(driver)
        driver.write({"drive_target": DriveState.ACTIVE})
        bench.read_until(driver, DriveState.ACTIVE)
        driver.safe_state()
        silent_for(bench, 2.0)
        assert bench.valve.state is DriveState.DISABLED
    driver.write({"drive_target": DriveState.HOLD})
    silent_for(bench, 2.0)
    assert not bench.valve.state.ready


def test_a_driver_closed_without_a_safe_state_leaves_the_valve_to_its_watchdog(
    bench: ValveBench,
) -> None:
    driver = bench.active()
    driver.close()
    driver.close()
    silent_for(bench, 2.0)
    assert bench.valve.state is DriveState.FAULT_HOLD
    driver.open()
    assert bench.read(driver, 10)["drive_state"] == DriveState.FAULT_HOLD


def test_a_driver_opened_again_asks_for_nothing_that_was_asked_for_before(
    bench: ValveBench,
) -> None:
    driver = bench.active()
    driver.close()
    silent_for(bench, 2.0)
    bench.valve.state = DriveState.DISABLED
    bench.valve.faults.stuck = True
    driver.open()
    bench.valve.faults.stuck = False
    commands = [event for event in bench.record.events if event["event"] == "drive_command"]
    bench.read(driver, 10)
    assert commands == [event for event in bench.record.events if event["event"] == "drive_command"]


def test_a_driver_that_is_not_open_says_so(bench: ValveBench) -> None:
    with pytest.raises(DriverError, match="drive: is not open; open it first"):
        bench.driver().read()
