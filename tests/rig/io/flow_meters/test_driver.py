import os
from array import array
from collections.abc import Iterator
from fcntl import ioctl
from itertools import pairwise
from math import isnan
from pathlib import Path
from termios import TIOCINQ

import pytest
import serial

from rig.emulator.meters import MeterPanel
from rig.emulator.record import Record
from rig.io.driver import Driver, DriverError
from rig.io.flow_meters.driver import FlowMeterOptions, FlowMeters
from rig.io.flow_meters.lines import meter_line
from rig.io.signals import METERS
from tests.rig.io.conftest import ManualClock
from tests.waiting import until

FLOWS = (1e-5, 2e-5, 3e-5)
TOLD = dict(zip(METERS, FLOWS, strict=True))
RESOLUTION = 1e-3 * 1e-3 / 60.0


class MeterBench:
    """Meters on a pseudo-terminal, and their driver, on a clock that the test turns."""

    def __init__(self, folder: Path) -> None:
        self.clock = ManualClock()
        self.samples = 0
        self.path = folder / "ttyMeters"
        self.panel = MeterPanel(self.path, lambda: FLOWS, Record(clock=self.clock))
        self.panel.plug_in()
        options = FlowMeterOptions(port=str(self.path), stale=0.5)
        self.driver = FlowMeters("meters", options, self.clock, self.wait)

    def wait(self, time_s: float) -> None:
        """Let time pass: the meters tell their flows meanwhile."""
        self.clock.advance(time_s)
        self.panel.send()
        self.samples += 1

    def read(self) -> dict[str, float]:
        """Return what is sent next; the line may bring it in pieces."""
        self.wait(0.1)
        flows: dict[str, float] = {}
        for signal in METERS:
            while signal not in flows:
                flows.update(until(self.driver.read))
        return flows

    def waiting(self) -> int:
        """Return how many bytes wait at the near end of the line."""
        near = os.open(self.path, os.O_RDONLY | os.O_NOCTTY)
        count = array("i", [0])
        ioctl(near, TIOCINQ, count)
        os.close(near)
        return count[0]

    def end(self) -> None:
        self.driver.close()
        self.panel.close()


@pytest.fixture
def meters(tmp_path: Path) -> Iterator[MeterBench]:
    bench = MeterBench(tmp_path)
    yield bench
    bench.end()


@pytest.fixture
def opened(meters: MeterBench) -> MeterBench:
    meters.driver.open()
    # It is open with the first line that came; the others may still be on their way.
    lines = meters.driver._parser.counts
    until(lambda: (meters.driver.read(), lines.valid == len(METERS) * meters.samples)[1])
    return meters


def test_it_is_a_driver_that_moves_nothing(meters: MeterBench) -> None:
    assert isinstance(meters.driver, Driver)
    assert meters.driver.inputs == METERS
    assert meters.driver.outputs == ()


def test_it_reads_three_flows_in_si(opened: MeterBench) -> None:
    assert opened.read() == pytest.approx(TOLD, abs=0.5 * RESOLUTION)


def test_it_returns_only_what_came_since_the_last_call(opened: MeterBench) -> None:
    opened.read()

    assert opened.driver.read() == {}


def test_what_waited_in_the_line_before_it_was_opened_is_not_news(meters: MeterBench) -> None:
    meters.panel.send()
    told = len(b"".join(meter_line(*line) for line in enumerate(FLOWS, start=1)))
    until(lambda: meters.waiting() == told)
    meters.panel.silent = True

    with pytest.raises(DriverError, match="no valid line"):
        meters.driver.open()


def test_a_failed_sensor_reads_nan_and_the_others_read_on(opened: MeterBench) -> None:
    opened.panel.failed.add(2)

    flows = opened.read()

    assert isnan(flows["flow_2_m3_per_s"])
    assert flows["flow_1_m3_per_s"] == pytest.approx(1e-5, abs=RESOLUTION)


def test_a_silent_line_has_no_values_after_half_a_second(opened: MeterBench) -> None:
    opened.read()
    opened.panel.silent = True

    opened.clock.advance(0.5)
    assert opened.driver.read() == {}
    opened.clock.advance(0.001)

    flows = opened.driver.read()
    assert tuple(flows) == METERS
    assert all(isnan(flow) for flow in flows.values())


def test_noise_between_the_lines_loses_none(opened: MeterBench) -> None:
    opened.panel.noisy = True

    for _ in range(20):
        assert tuple(opened.read()) == METERS

    assert opened.driver._parser.counts.valid >= 60


def test_cut_lines_have_no_values_and_do_not_cost_the_lines_after_them(
    opened: MeterBench,
) -> None:
    opened.panel.cutting = True
    for _ in range(20):
        opened.wait(0.01)
        assert opened.driver.read() == {}

    opened.panel.cutting = False

    assert opened.read() == pytest.approx(TOLD, abs=0.5 * RESOLUTION)


def test_an_unplugged_line_reads_nan_and_comes_back_when_it_is_plugged_in(
    opened: MeterBench,
) -> None:
    opened.read()
    opened.panel.unplug()

    until(lambda: (opened.driver.read(), opened.driver._port is None)[1])
    opened.clock.advance(0.6)
    assert all(isnan(flow) for flow in opened.driver.read().values())

    opened.panel.plug_in()
    opened.clock.advance(2.0)
    opened.driver.read()

    assert opened.driver._port is not None
    assert opened.read()["flow_1_m3_per_s"] == pytest.approx(1e-5, abs=RESOLUTION)


def test_an_unplugged_line_is_tried_less_and_less_often_and_afresh_after_each_time(
    opened: MeterBench,
) -> None:
    tried_at: list[float] = []

    def refuse() -> serial.Serial:
        tried_at.append(opened.clock.now_ns * 1e-9)
        raise OSError

    for _ in range(2):
        opened.panel.unplug()
        opened.driver.read()
        tried_at.clear()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(opened.driver, "_plugged", refuse)
            for _ in range(1000):
                opened.clock.advance(0.01)
                opened.driver.read()

        pauses = [b - a for a, b in pairwise(tried_at)]
        assert pauses == pytest.approx([0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0])

        opened.panel.plug_in()
        opened.clock.advance(2.0)
        opened.driver.read()
        assert opened.driver._port is not None


def test_a_port_that_is_not_there_is_refused_with_the_remedy(meters: MeterBench) -> None:
    meters.panel.close()

    with pytest.raises(DriverError) as caught:
        meters.driver.open()

    assert caught.value.driver == "meters"
    assert str(meters.path) in caught.value.state
    assert "check the plug" in caught.value.action


def test_a_line_without_meters_is_refused(meters: MeterBench) -> None:
    meters.panel.silent = True

    with pytest.raises(DriverError, match=r"no valid line within 0\.5 s \(0 others\)"):
        meters.driver.open()

    with pytest.raises(DriverError, match="is not open"):
        meters.driver.read()


def test_it_refuses_to_write(opened: MeterBench) -> None:
    with pytest.raises(DriverError, match="meters, command_V: is not an output"):
        opened.driver.write({"command_V": 1.0})


def test_the_line_holds_its_name_only_while_it_is_plugged_in(tmp_path: Path) -> None:
    panel = MeterPanel(tmp_path / "tty", lambda: FLOWS, Record())

    panel.plug_in()
    assert os.path.realpath(tmp_path / "tty").startswith("/dev/")
    panel.close()

    assert not (tmp_path / "tty").is_symlink()


def test_a_name_left_by_an_emulator_that_was_killed_is_replaced_but_no_file(
    tmp_path: Path,
) -> None:
    (tmp_path / "left").symlink_to("/dev/pts/left")
    (tmp_path / "file").write_text("precious")

    panel = MeterPanel(tmp_path / "left", lambda: FLOWS, Record())
    panel.plug_in()
    panel.close()

    with pytest.raises(ValueError, match="is there, and is no link"):
        MeterPanel(tmp_path / "file", lambda: FLOWS, Record()).plug_in()
    assert (tmp_path / "file").read_text() == "precious"
