import re
from pathlib import Path
from struct import pack, unpack
from typing import Any

import pytest

from rig.configuration.rigs.rig import load_rig
from rig.emulator.instruments import CARRIED
from rig.emulator.modbus.functions import ModbusException, serve
from rig.emulator.modbus.io_node import Control, IoNode, Status
from rig.io.signals import FAST_INPUTS, METERS

Bench = Any

ENABLE, REARM, LAMP = Control.VALVE_ENABLE, Control.REARM, Control.RESET_LAMP


class Host:
    """Writes the node's write block as a controller does, a tick at a time."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.counter = 0

    def exchange(self, bits: Control, command: float = 1.0, counts: bool = True) -> None:
        self.counter += counts
        self.bench.node.write(0, pack(">HHf", self.counter, bits, command))
        self.bench.clock.advance(1e-3)

    def enable(self) -> None:
        self.exchange(LAMP)
        self.bench.node.press_reset(True)
        self.bench.node.press_reset(False)
        self.exchange(ENABLE)


@pytest.fixture
def host(bench: Bench) -> Host:
    return Host(bench)


def status(node: IoNode) -> Status:
    return Status(int.from_bytes(node.read(257, 1), "big"))


def output(node: IoNode) -> float:
    return float(unpack(">f", node.read(274, 2))[0])


def enabled(node: IoNode) -> bool:
    return Status.VALVE_ENABLED in status(node)


def code(node: IoNode, address: int, data: bytes) -> int:
    with pytest.raises(ModbusException) as refused:
        node.write(address, data)
    return refused.value.code


def test_the_node_says_what_it_is(bench: Bench) -> None:
    identity, version, watchdog_ms, rate_hz, power_up_id, _ = unpack(">6H", bench.node.read(512, 6))
    assert (identity, version, watchdog_ms, rate_hz) == (0x5249, 1, 100, 1000)
    assert power_up_id > 0


def test_after_power_up_the_valve_stays_disabled_until_the_reset_button_is_pressed(
    bench: Bench, host: Host
) -> None:
    for _ in range(10):
        host.exchange(ENABLE)
    assert not enabled(bench.node)
    assert output(bench.node) == 0.0
    host.enable()
    assert enabled(bench.node)
    assert output(bench.node) == 1.0


def test_the_button_counts_only_while_the_lamp_is_lit(bench: Bench, host: Host) -> None:
    bench.node.press_reset(True)
    host.exchange(ENABLE | LAMP)
    assert not enabled(bench.node)


def test_a_button_held_down_is_no_rising_edge(bench: Bench, host: Host) -> None:
    bench.node.press_reset(True)
    host.exchange(LAMP)
    bench.node.press_reset(True)
    host.exchange(ENABLE)
    assert not enabled(bench.node)


def test_without_a_running_host_the_watchdog_nulls_the_valve_at_its_deadline(
    bench: Bench, host: Host
) -> None:
    host.enable()
    silent_since = bench.clock() - 1_000_000
    bench.clock.advance(3.0)
    assert output(bench.node) == 0.0
    assert Status.WATCHDOG_TRIPPED in status(bench.node)
    trip = next(e for e in bench.record.events if e["event"] == "watchdog_trip")
    assert trip["at_ns"] == silent_since + 100_000_000


def test_the_plant_stops_at_the_watchdogs_deadline_not_when_somebody_looks(
    bench: Bench, host: Host
) -> None:
    host.enable()
    start = bench.plant.truth.position
    bench.clock.advance(3.0)
    bench.node.tend()
    # At 1 V the ram makes some 0.12 m/s: 0.012 m in 0.1 s, and to the end of its stroke in 3 s.
    assert start < bench.plant.truth.position < start + 0.03


def test_a_host_that_counts_keeps_the_watchdog_quiet(bench: Bench, host: Host) -> None:
    host.enable()
    for _ in range(300):
        host.exchange(ENABLE)
    assert enabled(bench.node)


def test_a_host_that_repeats_its_counter_is_a_dead_host(bench: Bench, host: Host) -> None:
    host.enable()
    for _ in range(101):
        host.exchange(ENABLE, counts=False)
    assert Status.WATCHDOG_TRIPPED in status(bench.node)


def test_a_host_that_has_disabled_the_valve_may_be_silent(bench: Bench, host: Host) -> None:
    host.enable()
    host.exchange(Control(0), command=0.0)
    bench.clock.advance(5.0)
    assert Status.WATCHDOG_TRIPPED not in status(bench.node)


def test_a_tripped_watchdog_needs_rearming_and_the_button(bench: Bench, host: Host) -> None:
    host.enable()
    bench.clock.advance(0.2)
    host.enable()
    assert not enabled(bench.node)
    host.exchange(REARM)
    assert Status.WATCHDOG_TRIPPED not in status(bench.node)
    host.exchange(ENABLE)
    assert enabled(bench.node)


def test_rearming_alone_does_not_enable_the_valve(bench: Bench, host: Host) -> None:
    host.enable()
    bench.clock.advance(0.2)
    host.exchange(REARM)
    host.exchange(ENABLE)
    assert Status.WATCHDOG_TRIPPED not in status(bench.node)
    assert not enabled(bench.node)


def test_rearming_is_an_edge(bench: Bench, host: Host) -> None:
    host.enable()
    host.exchange(ENABLE | REARM)
    bench.clock.advance(0.2)
    host.exchange(ENABLE | REARM)
    assert Status.WATCHDOG_TRIPPED in status(bench.node)


def test_rearming_takes_a_host_whose_counter_changes_again(bench: Bench, host: Host) -> None:
    host.enable()
    bench.clock.advance(0.2)
    host.exchange(Control(0), counts=False)
    host.exchange(ENABLE | REARM, counts=False)
    assert Status.WATCHDOG_TRIPPED in status(bench.node)


def test_beyond_its_range_the_output_saturates(bench: Bench, host: Host) -> None:
    host.enable()
    host.exchange(ENABLE, command=25.0)
    assert output(bench.node) == 10.0


def test_the_exchange_of_the_nodes_page_is_answered_as_it_says(bench: Bench, host: Host) -> None:
    page = (Path(__file__).parents[4] / "docs" / "io_node.md").read_text()
    request, answer = map(bytes.fromhex, re.findall(r"```hex\n(.*?)```", page, re.DOTALL))
    host.enable()
    reply = serve(bench.node, request[7:])
    assert len(reply) == len(answer[7:])
    assert reply[:2] == answer[7:9]
    assert reply[4:8] == answer[11:15]
    assert reply[-4:] == answer[-4:]


def test_a_null_request_holds_until_the_reset_sequence(bench: Bench, host: Host) -> None:
    host.enable()
    bench.node.write(768, b"\0\1")
    assert output(bench.node) == 0.0
    assert bench.node.read(768, 1) == b"\0\1"
    for _ in range(5):
        host.exchange(ENABLE)
    assert not enabled(bench.node)
    host.enable()
    assert enabled(bench.node)
    assert bench.node.read(768, 1) == b"\0\0"


def test_the_emergency_stop_disables_and_needs_the_button_once_it_is_pulled_out(
    bench: Bench, host: Host
) -> None:
    host.enable()
    bench.node.press_estop(True)
    assert not enabled(bench.node)
    assert Status.ESTOP_CLOSED not in status(bench.node)
    host.enable()
    assert not enabled(bench.node)
    bench.node.press_estop(False)
    host.exchange(ENABLE)
    assert not enabled(bench.node)
    host.enable()
    assert enabled(bench.node)


def test_the_record_tells_when_and_why_the_valve_was_disabled(bench: Bench, host: Host) -> None:
    host.enable()
    bench.node.press_estop(True)
    last = bench.record.events[-1]
    assert last["event"] == "valve_disabled"
    assert last["cause"] == "estop"
    assert last["at_ns"] == bench.clock()


def test_the_node_returns_the_hosts_counter_and_counts_its_own_samples(
    bench: Bench, host: Host
) -> None:
    host.exchange(ENABLE)
    first, _, echo = unpack(">3H", bench.node.read(256, 3))
    second = int.from_bytes(bench.node.read(256, 1), "big")
    assert echo == host.counter
    assert second == first + 1


def test_the_encoder_counts_from_where_it_was_switched_on(bench: Bench, host: Host) -> None:
    assert unpack(">i", bench.node.read(262, 2)) == (0,)
    host.enable()
    for _ in range(100):
        host.exchange(ENABLE)
    (counts,) = unpack(">i", bench.node.read(262, 2))
    moved = bench.plant.truth.position - 0.30345
    assert counts == pytest.approx(moved / 3e-5, abs=1.0)
    assert counts > 0


def test_lost_counts_stay_lost_and_are_flagged_only_if_noticed(bench: Bench) -> None:
    bench.node.lose_counts(40, flagged=False)
    assert unpack(">i", bench.node.read(262, 2)) == (-40,)
    assert Status.ENCODER_FAULT not in status(bench.node)
    bench.node.lose_counts(0, flagged=True)
    assert Status.ENCODER_FAULT in status(bench.node)


def test_a_whole_sample_agrees_with_the_plant(bench: Bench) -> None:
    values = unpack(">HHHHIi6f", bench.node.read(256, 20))
    truth = bench.plant.truth
    assert 1e3 * values[6] == pytest.approx(truth.pressure_1, abs=2e5)
    assert 1e3 * values[7] == pytest.approx(truth.pressure_2, abs=2e5)
    assert 1e3 * values[8] == pytest.approx(truth.supply_pressure, abs=2e5)


def test_part_of_the_read_block_is_the_same_registers(bench: Bench) -> None:
    bench.node.read(256, 20)
    bench.node.frozen = True
    assert bench.node.read(256, 20)[16:24] == bench.node.read(264, 4)


def test_a_hanging_node_returns_its_last_sample_for_ever(bench: Bench, host: Host) -> None:
    sample = bench.node.read(256, 20)
    bench.node.frozen = True
    host.exchange(ENABLE)
    assert bench.node.read(256, 20) == sample


@pytest.mark.parametrize("watchdog_ms", [0, 1001, 65535])
def test_an_absurd_watchdog_time_is_refused(bench: Bench, watchdog_ms: int) -> None:
    assert code(bench.node, 514, pack(">H", watchdog_ms)) == 3


def test_the_watchdogs_time_can_be_set(bench: Bench, host: Host) -> None:
    bench.node.write(514, pack(">H", 20))
    host.enable()
    bench.clock.advance(0.021)
    assert Status.WATCHDOG_TRIPPED in status(bench.node)


@pytest.mark.parametrize("command", [float("nan"), float("inf")])
def test_a_command_that_is_no_number_is_refused_and_nothing_written(
    bench: Bench, host: Host, command: float
) -> None:
    host.enable()
    assert code(bench.node, 0, pack(">HHf", 99, ENABLE, command)) == 3
    assert output(bench.node) == 1.0
    assert bench.node.read(0, 1) != pack(">H", 99)


@pytest.mark.parametrize("address", [5, 255, 256, 275, 512, 513, 515, 516, 517, 769, 65535])
def test_registers_that_cannot_be_written_are_refused(bench: Bench, address: int) -> None:
    assert code(bench.node, address, b"\0\0") == 2


@pytest.mark.parametrize(
    ("address", "count"), [(5, 1), (4, 2), (255, 1), (275 + 2 * len(CARRIED), 2), (518, 1)]
)
def test_registers_that_there_are_not_are_refused(bench: Bench, address: int, count: int) -> None:
    with pytest.raises(ModbusException) as refused:
        bench.node.read(address, count)
    assert refused.value.code == 2


def test_what_the_host_wrote_can_be_read_back(bench: Bench, host: Host) -> None:
    host.exchange(ENABLE, command=2.5)
    assert unpack(">HHf", bench.node.read(0, 4)) == (host.counter, ENABLE, 2.5)


def test_a_node_has_every_signal_but_the_flows_which_meters_measure(bench: Bench) -> None:
    daq = next(spec for spec in load_rig("emulated").drivers if spec.kind == "fast")
    assert set(FAST_INPUTS) - set(daq.inputs) == {*METERS, *CARRIED}


def test_a_node_carries_the_tank_s_temperature_behind_what_every_node_has(bench: Bench) -> None:
    whole = bench.node.read(256, 22)
    assert unpack(">f", whole[40:]) == (pytest.approx(313.15, abs=1e-4),)
    bench.instruments.fail("tank_temperature_K", "high")
    assert unpack(">f", bench.node.read(276, 2)) == (pytest.approx(423.15, abs=1e-4),)


def test_the_shipped_register_map_reads_what_the_node_packs(bench: Bench, host: Host) -> None:
    daq = next(spec for spec in load_rig("emulated").drivers if spec.kind == "fast")
    registers = {register.signal: register for register in daq.options.map.registers}
    host.enable()
    bench.node.read(256, 20)
    bench.node.frozen = True
    truth = bench.plant.truth
    for signal, expected in (
        ("pressure_1_Pa", truth.pressure_1),
        ("pressure_2_Pa", truth.pressure_2),
        ("supply_pressure_Pa", truth.supply_pressure),
        ("spool_m", truth.spool),
        ("device_command_V", 1.0),
    ):
        register = registers[signal]
        (value,) = unpack(">f", bench.node.read(register.address, 2))
        assert register.gain * value == pytest.approx(expected, rel=0.03, abs=5e-6)
