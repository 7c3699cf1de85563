import pickle
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from rig.channels import Kind, names_of
from rig.configuration.reading.document import Sources
from rig.configuration.reading.lookup import shipped_config_dir
from rig.configuration.rigs.register_maps import read_map
from rig.io.modbus_daq.register_map import (
    UNITS,
    Fact,
    Register,
    RegisterMap,
    RegisterMapError,
    RegisterValue,
    Span,
    Watchdog,
    block,
    feedback_bytes,
    spans,
)
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS, METERS
from tests.rig.io.modbus_bench import map_of, shipped_map

COMMAND = Register("command_V", 0, "F32", "rw", unit="V")
POSITION = Register("position_m", 256, "I32", "r", scale=0.03, unit="mm")


def problems_of(*registers: Register, **changes: Any) -> list[str]:
    with pytest.raises(RegisterMapError) as caught:
        map_of(*registers, **changes)
    return [str(problem) for problem in caught.value.problems]


def test_the_io_node_has_every_signal_but_the_leak_flows_and_what_not_every_node_carries() -> None:
    node = shipped_map("io_node")

    signals = {register.signal for register in node.registers}
    missing = {name for name in (*FAST_INPUTS, *FAST_OUTPUTS) if name not in signals}
    assert missing == {*METERS, *names_of(Kind.CARRIED)}
    assert block(node.written) == Span(0, 4)
    assert block(node.read) == Span(256, 20)


def test_the_io_node_s_map_takes_in_what_a_node_carries_line_by_line(tmp_path: Path) -> None:
    shipped = (shipped_config_dir() / "maps" / "io_node.yaml").read_text()
    path = tmp_path / "my_node.yaml"
    path.write_text(shipped.replace("  # - {signal", "  - {signal"))
    root = Sources().read_yaml(path)
    assert root is not None
    found = read_map(root)

    assert isinstance(found, RegisterMap)
    carried = found.registers[len(shipped_map("io_node").registers) :]
    assert tuple(register.signal for register in carried) == names_of(Kind.CARRIED)
    assert block(found.read) == Span(256, 20 + 2 * len(carried))


@pytest.mark.parametrize("name", ["io_node", "labjack_t7", "labjack_t8"])
def test_shipped_maps_have_what_the_loop_cannot_do_without(name: str) -> None:
    found = shipped_map(name)

    signals = {register.signal for register in found.registers}
    assert {"command_V", "valve_enable", "position_m", "estop_closed", "valve_enabled"} <= signals
    assert found.watchdog is not None


@pytest.mark.parametrize("name", ["labjack_t7", "labjack_t8"])
def test_a_labjack_s_watchdog_is_off_while_it_is_set_and_drops_the_valve_s_relay(name: str) -> None:
    found = shipped_map(name)
    assert found.watchdog is not None

    relay = next(r for r in found.registers if r.signal == "valve_enable")
    line = relay.address - 2000
    values = {value.address: int(value.value) for value in found.setup}
    assert values[61600] == 0
    assert found.watchdog.arm == (RegisterValue(61600, "U32", 1),)
    assert values[61632] >> line & 1 == 0
    assert values[61634] >> line & 1 == 1
    assert values[61636] >> line & 1 == 0


def test_all_that_is_wrong_with_a_map_is_reported_at_once() -> None:
    found = problems_of(
        Register("command_V", 70000, "F32", "r", unit="mm"),
        Register("position", 0, "U16", "r"),
        Register("estop_closed", 257, "F32", "r", bit=3, unit="V"),
        Register("load_N", 3, "F32", "r", scale=0.0, offset=float("nan"), unit="N"),
        rate=0.0,
        exchange=(),
        identity=RegisterValue(65535, "U32", 1),
        watchdog=Watchdog(-1, "U16", 0.0, 2.0, 1.0),
        facts=(Fact("power_up_id", 65536, "U16"),),
    )

    assert [problem.split(":")[0] for problem in found] == [
        "registers[0].access",
        "registers[0].address",
        "registers[0].unit",
        "registers[1].signal",
        "registers[2].bit",
        "registers[2].unit",
        "registers[3].scale",
        "registers[3].offset",
        "exchange",
        "rate",
        "watchdog.shortest",
        "watchdog.counts_per_s",
        "identity.address",
        "watchdog.address",
        "facts[0].address",
    ]
    assert "registers[0].unit: mm is no unit of command_V; one of V, mV" in found


@pytest.mark.parametrize(
    ("registers", "problem"),
    [
        ((POSITION,), "registers: command_V has no register"),
        ((COMMAND,), "registers: none is read"),
        ((COMMAND, POSITION, POSITION), "registers[2].signal: position_m has a register already"),
        (
            (COMMAND, POSITION, Register("load_N", 257, "F32", "r", unit="N")),
            "registers[2].address: 257 of load_N overlaps position_m at 256",
        ),
        (
            (COMMAND, POSITION, Register("valve_enable", 1, "U16", "w")),
            "registers[2].address: 1 of valve_enable overlaps command_V at 0",
        ),
        (
            (
                COMMAND,
                Register("estop_closed", 300, "U16", "r", bit=2),
                Register("reset_button", 300, "U16", "r", bit=2),
            ),
            "registers[2].address: 300 of reset_button overlaps estop_closed at 300",
        ),
        (
            (COMMAND, POSITION, Register("load_N", 380, "F32", "r", unit="N")),
            "exchange[0]: fc23 needs 126 registers from 256, above 125",
        ),
        (
            (COMMAND, POSITION, Register("valve_enable", 3, "U16", "w")),
            "exchange[0]: fc23 would write 0 into the gaps from 0 on",
        ),
    ],
)
def test_registers_that_cannot_be_exchanged_are_refused(
    registers: tuple[Register, ...], problem: str
) -> None:
    assert any(found.startswith(problem) for found in problems_of(*registers))


def test_registers_far_apart_can_be_exchanged_by_feedback() -> None:
    far = Register("valve_enable", 30000, "U16", "w")

    assert map_of(COMMAND, POSITION, far, exchange=("fc76",)).written == (COMMAND, far)


def test_switches_share_a_word() -> None:
    bits = [
        Register("estop_closed", 300, "U16", "r", bit=0),
        Register("reset_button", 300, "U16", "r", bit=15),
    ]

    assert spans(map_of(COMMAND, *bits).read) == (Span(300, 1),)


def test_a_register_means_its_scale_and_offset_in_its_unit() -> None:
    pressure = Register("pressure_1_Pa", 0, "F32", "r", scale=2.0, offset=-1.0, unit="bar")

    assert (pressure.gain, pressure.bias) == (2e5, -1e5)


def test_a_feedback_packet_is_counted_as_labjack_frames_it() -> None:
    # Header 8; each frame 4, and 2 for every register written; in the reply 2 for every one read.
    assert feedback_bytes([Span(0, 10), Span(3000, 2)], [Span(2004, 1)]) == (8 + 12 + 2, 8 + 24)


def test_problems_survive_the_way_to_another_process() -> None:
    with pytest.raises(RegisterMapError, match=re.escape("rate: 0.0 is not above 0")) as caught:
        replace(shipped_map("io_node"), rate=0.0)

    assert pickle.loads(pickle.dumps(caught.value)).problems == caught.value.problems


@pytest.mark.parametrize(
    ("unit", "ending", "factor"),
    [
        ("psi", "Pa", 6894.757293168361),
        ("in", "m", 0.0254),
        ("gpm", "m3_per_s", 3.785411784e-3 / 60.0),
    ],
)
def test_a_register_may_be_in_units_of_american_instruments(
    unit: str, ending: str, factor: float
) -> None:
    assert UNITS[unit][0] == ending
    assert UNITS[unit][1] == pytest.approx(factor, rel=1e-12)
