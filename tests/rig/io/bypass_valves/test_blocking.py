"""Blocking valves that the bypass valves' device drives, too."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from rig.channels import BLOCKING
from rig.emulator.modbus.bypass_io import BypassIo
from rig.io.bypass_valves.driver import BLOCKING_TRAVEL_S
from rig.io.driver import DriverError
from rig.supervisor.processes.driven import departures
from tests.rig.io.conftest import BypassBench, DeviceThread

TRAVEL_S = 0.2
SHUT = dict.fromkeys(BLOCKING, 1.0)


class BlockingBench(BypassBench):
    """A bench whose device has blocking valves."""

    def __init__(self, thread: DeviceThread, folder: Path) -> None:
        super().__init__(thread, folder)
        with_blocking = BypassIo(self.record, self.clock, blocking_travel_s=TRAVEL_S)
        thread.call(self.device.close)
        self.device = with_blocking
        self.port = thread.run(with_blocking.open("127.0.0.1", 0))


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[BlockingBench]:
    thread = DeviceThread()
    bench = BlockingBench(thread, tmp_path)
    yield bench
    bench.end()
    thread.end()


def test_they_shut_on_order_and_their_switches_tell_it(bench: BlockingBench) -> None:
    driver = bench.driver(blocking=True, watchdog=0.0)
    driver.open()
    assert [driver.read()[valve] for valve in BLOCKING] == [0.0, 0.0]

    driver.write({"blocking_1": 1.0})
    bench.clock.advance(0.5 * TRAVEL_S)
    assert driver.read()["blocking_1"] == 0.5
    bench.clock.advance(TRAVEL_S)

    assert [driver.read()[valve] for valve in BLOCKING] == [1.0, 0.0]


def test_their_safe_state_is_open_as_of_no_other_valve(bench: BlockingBench) -> None:
    driver = bench.driver(blocking=True, watchdog=0.0)
    driver.open()
    driver.write({**SHUT, "internal_leakage_ball": 1.0})
    bench.clock.advance(1.0)

    driver.safe_state()

    assert bench.device.valves.blocking() == dict.fromkeys(BLOCKING, 0.0)
    assert driver.read()["internal_leakage_ball"] == 0.0


def test_the_device_opens_them_by_itself_if_nobody_asks_it(bench: BlockingBench) -> None:
    driver = bench.driver(blocking=True, watchdog=1.0)
    driver.open()
    driver.write(SHUT)
    bench.clock.advance(0.9)
    shut = bench.device.valves.blocking()
    bench.clock.advance(0.2 + TRAVEL_S)

    assert shut == SHUT
    assert bench.device.valves.blocking() == dict.fromkeys(BLOCKING, 0.0)


def test_one_that_stays_shut_is_named_with_what_to_do_about_the_pressure(
    bench: BlockingBench,
) -> None:
    driver = bench.driver(blocking=True, watchdog=0.0)
    driver.open()
    driver.write(SHUT)
    bench.clock.advance(1.0)
    bench.device.valves.stick("blocking_2")

    with pytest.raises(DriverError, match=r"blocking_2: not open, stands at 1.*relieve it by hand"):
        driver.safe_state()


def test_one_that_does_not_arrive_within_the_longest_travel_is_stuck(bench: BlockingBench) -> None:
    driver = bench.driver(blocking=True, watchdog=0.0, margin=0.1)
    driver.open()
    bench.device.valves.stick("blocking_1")
    driver.write(SHUT)
    bench.clock.advance(BLOCKING_TRAVEL_S)
    driver.read()
    bench.clock.advance(0.2)

    with pytest.raises(DriverError, match="blocking_1: stuck at 0"):
        driver.read()


def test_a_device_without_them_is_refused_with_the_remedy(bypass: BypassBench) -> None:
    driver = bypass.driver(blocking=True)
    with pytest.raises(DriverError, match=r"does not serve blocking valves.*`blocking: true`"):
        driver.open()


def test_half_an_order_is_refused(bench: BlockingBench) -> None:
    driver = bench.driver(blocking=True)
    driver.open()
    with pytest.raises(DriverError, match=r"0\.5 is neither 0 nor 1"):
        driver.write({"blocking_1": 0.5})


def test_one_that_another_master_shuts_is_told_as_driven() -> None:
    assert departures({"blocking_1": 1.0, "blocking_2": 0.0}) == {"blocking valve 1": "shut"}
