"""The bypass valves' I/O as any Modbus client sees it, here pymodbus's own."""

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, strategies as st
from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

from rig.channels import BYPASSES
from rig.emulator.addresses import AddressError
from rig.emulator.modbus.bypass_io import BypassIo
from rig.emulator.modbus.valve_bank import ValveBank
from rig.emulator.record import Record
from tests.rig.io.conftest import DeviceThread, ManualClock

IDENTITY, WATCHDOG = 100, 101
ILLEGAL_ADDRESS, ILLEGAL_VALUE = 2, 3


class Served:
    """The I/O on a port of its own, its time the test's, and a client of it."""

    def __init__(self, thread: DeviceThread) -> None:
        self.clock = ManualClock()
        self.record = Record(clock=self.clock)
        self.device = BypassIo(self.record, self.clock)
        self.thread = thread
        self.port = thread.run(self.device.open("127.0.0.1", 0))
        self.client = ModbusTcpClient("127.0.0.1", port=self.port, timeout=10.0, retries=0)
        assert self.client.connect()

    def switches(self) -> list[bool]:
        return list(self.client.read_discrete_inputs(0, count=10).bits[:10])

    def needles(self) -> list[int]:
        return list(self.client.read_input_registers(0, count=5).registers)

    def events(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in list(self.record.events) if event["event"] == kind]

    def end(self) -> None:
        self.client.close()
        self.thread.close(self.device.close)


@pytest.fixture
def served() -> Iterator[Served]:
    thread = DeviceThread()
    found = Served(thread)
    yield found
    found.end()
    thread.end()


def test_it_is_identified_by_a_register_that_cannot_be_written(served: Served) -> None:
    assert served.client.read_holding_registers(IDENTITY, count=1).registers == [0x4256]
    assert served.client.write_register(IDENTITY, 1).exception_code == ILLEGAL_ADDRESS
    assert served.client.read_holding_registers(IDENTITY, count=1).registers == [0x4256]


def test_a_coil_opens_its_ball_and_both_switches_are_off_meanwhile(served: Served) -> None:
    served.client.write_coil(1, True)
    served.clock.advance(0.25)
    under_way = served.switches()
    served.clock.advance(0.25)

    assert under_way[:4] == [False, True, False, False]
    assert served.switches()[:4] == [False, True, True, False]
    assert served.client.read_coils(0, count=5).bits[:5] == [False, True, False, False, False]


def test_all_coils_can_be_written_at_once_and_the_throttles_does_nothing(served: Served) -> None:
    served.client.write_coils(0, [True] * 5)
    served.clock.advance(1.0)

    assert [ball for ball, _ in served.device.valves.positions().values()] == [1.0] * 5
    assert [event["bypass"] for event in served.events("ball_ordered")] == list(BYPASSES[:4])


def test_the_record_tells_when_a_ball_arrived_whenever_somebody_looked(served: Served) -> None:
    ordered_ns = served.clock.now_ns
    served.client.write_coil(1, True)
    served.clock.advance(7.0)
    served.switches()

    (arrival,) = served.events("ball_arrived")
    assert arrival == {
        "at_ns": ordered_ns + 500_000_000,
        "event": "ball_arrived",
        "bypass": BYPASSES[1],
        "opened": True,
    }


def test_needles_slew_to_setpoints_that_read_back(served: Served) -> None:
    served.client.write_registers(0, [10_000, 2_500, 0, 0, 5_000])
    served.clock.advance(1.0)

    assert served.needles() == [5_000, 2_500, 0, 0, 5_000]
    assert served.client.read_holding_registers(0, count=5).registers == [
        10_000,
        2_500,
        0,
        0,
        5_000,
    ]


def test_what_there_is_not_is_refused_and_moves_nothing(served: Served) -> None:
    assert served.client.write_registers(0, [1, 10_001]).exception_code == ILLEGAL_VALUE
    assert served.client.write_coils(3, [True] * 3).exception_code == ILLEGAL_ADDRESS
    assert served.client.read_holding_registers(5, count=1).exception_code == ILLEGAL_ADDRESS
    assert not served.events("ball_ordered")
    assert not served.events("needle_ordered")


def test_an_armed_watchdog_shuts_what_nobody_asks_for(served: Served) -> None:
    served.client.write_register(WATCHDOG, 700)
    served.client.write_coils(0, [True] * 4)
    served.client.write_registers(0, [5_000] * 5)
    for _ in range(6):
        served.clock.advance(0.6)
        served.switches()
    assert not served.events("bypass_watchdog_trip")

    silent_since = served.clock.now_ns
    served.clock.advance(10.0)

    assert served.client.read_coils(0, count=4).bits[:4] == [False] * 4
    assert served.switches()[:8] == [False, True] * 4
    assert served.needles() == [5_000] * 4 + [0]
    (trip,) = served.events("bypass_watchdog_trip")
    assert trip["at_ns"] == silent_since + 700_000_000


def test_a_port_that_is_taken_is_refused_with_the_reason(served: Served) -> None:
    second = BypassIo(served.record, served.clock)

    with pytest.raises(AddressError, match=f"bypass: port {served.port} of 127.0.0.1 is in use"):
        served.thread.run(second.open("127.0.0.1", served.port))


def test_one_that_refuses_everybody_lets_nobody_stay(served: Served) -> None:
    served.device.wire.refuses = True
    other = ModbusTcpClient("127.0.0.1", port=served.port, timeout=10.0, retries=0)

    other.connect()
    with pytest.raises((ModbusException, OSError)):
        other.read_coils(0, count=1)

    other.close()


def test_one_that_comes_while_another_is_refused_is_refused_too(served: Served) -> None:
    served.device.wire.refuses = True
    first, second = (
        ModbusTcpClient("127.0.0.1", port=served.port, timeout=10.0, retries=0) for _ in range(2)
    )

    async def come() -> None:
        """Connect the second within the turn of the device's loop that accepts the first."""
        first.connect()
        asyncio.get_running_loop().call_later(0.0, second.connect)

    served.thread.run(come())
    for each in (first, second):
        with pytest.raises((ModbusException, OSError)):
            each.read_coils(0, count=1)
        each.close()


def test_a_delayed_reply_comes_late(served: Served) -> None:
    slept: list[float] = []
    real_sleep = asyncio.sleep

    async def sleep(time_s: float) -> None:
        slept.append(time_s)
        await real_sleep(0)

    served.device.wire.delay_s = 3.0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rig.emulator.modbus.bypass_io.asyncio.sleep", sleep)
        assert served.needles() == [0] * 5

    assert slept == [3.0]


@given(
    opening=st.floats(0.0, 1.0),
    looks=st.lists(st.integers(0, 1_000_000_000), max_size=20),
    stuck=st.booleans(),
)
def test_where_a_valve_stands_does_not_depend_on_who_looks(
    opening: float, looks: list[int], stuck: bool
) -> None:
    seen, unseen = ManualClock(), ManualClock()
    noted, noted_unwatched = Record(clock=seen), Record(clock=unseen)
    watched, unwatched = ValveBank(noted, seen), ValveBank(noted_unwatched, unseen)
    for bank in (watched, unwatched):
        bank.watch(900)
        bank.order_ball("supply_leakage", opened=True)
        bank.order_needle("supply_leakage", opening)
        bank.order_needle("return_blockage", opening)
        if stuck:
            bank.stick("supply_leakage")
    # A tenth of a second after the watchdog: what it shuts is on its way.
    start = seen.now_ns
    for at in sorted(looks):
        seen.now_ns = start + at
        watched.tend()
    seen.now_ns = unseen.now_ns = start + 1_000_000_000

    positions = unwatched.positions()
    for bypass, found in watched.positions().items():
        assert found == pytest.approx(positions[bypass], abs=1e-9)
    assert list(noted.events) == list(noted_unwatched.events)
