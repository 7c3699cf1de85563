"""Register maps and DBC files are checked like any configuration, and found by name."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError
from rig.configuration.checking import check
from rig.configuration.reading.document import Sources
from rig.configuration.reading.lookup import copy_shipped, shipped_config_dir
from rig.configuration.rigs.register_maps import Map, read_map
from rig.configuration.rigs.rig import load_rig
from rig.io.bypass_valves.registers import BypassRegisters
from rig.io.modbus_daq.register_map import RegisterMap

SMALL = """device: small node
exchange: [fc23]
rate: 500 Hz
registers:
  - {signal: command_V, address: 0, type: F32, unit: V, access: w}
  - {signal: position_m, address: 10, type: I32, scale: 0.03, unit: mm, access: r}
identity: {address: 20, type: U16, value: 7}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "small.yaml"
    path.write_text(text)
    return path


def map_in(path: Path) -> Map | None:
    root = Sources().read_yaml(path)
    assert root is not None
    return read_map(root)


def problems_of(text: str, folder: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        check(write(folder, text))
    return [str(problem).removeprefix(f"{folder}/") for problem in caught.value.problems]


def test_a_map_is_read_into_what_its_driver_works_by(tmp_path: Path) -> None:
    device_map = map_in(write(tmp_path, SMALL))
    assert isinstance(device_map, RegisterMap)
    assert device_map.rate == 500.0
    (position,) = device_map.read
    assert position.gain == pytest.approx(3e-5)
    assert device_map.identity.value == 7.0


def test_the_map_of_a_bypass_device_is_distinguished_from_that_of_a_daq(tmp_path: Path) -> None:
    path = write(tmp_path, "coils: 16\nswitches: 32\nidentity: 200\n")
    assert map_in(path) == BypassRegisters(coils=16, switches=32, identity=200)
    assert "coils 16, switches 32" in str(check(path))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("fc23", "fc24", "small.yaml:2:12 exchange[0]: fc24 is not a choice here; did you mean"),
        ("500 Hz", "0 Hz", "small.yaml:3:1 rate: 0 Hz is below 0.1 Hz"),
        ("I32", "I64", "small.yaml:6:39 type: I64 is not a choice here; did you mean"),
        ("unit: mm", "unit: kPa", "small.yaml:6:63 unit: kPa is no unit of position_m; one of m,"),
        ("access: r}", "acess: r}", "small.yaml:6:73 acess: is not a known key; did you mean"),
        ("position_m", "postion_m", "small.yaml:6:6 signal: postion_m is no signal"),
        ("address: 20", "address: -1", "small.yaml:7:12 address: -1 is no address of a U16"),
        ("address: 20, ", "", "small.yaml:7:1 identity: lacks the key address; add"),
    ],
)
def test_a_mistake_in_a_map_is_named_with_its_place(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    problems = problems_of(SMALL.replace(old, new, 1), tmp_path)
    assert any(problem.startswith(expected) for problem in problems), "\n".join(problems)


def test_all_mistakes_of_a_map_are_reported_at_once(tmp_path: Path) -> None:
    text = SMALL.replace("500 Hz", "500").replace("F32", "F16").replace("value: 7", "value: seven")
    assert [problem.split(" ")[1] for problem in problems_of(text, tmp_path)] == [
        "rate:",
        "type:",
        "value:",
    ]


def test_an_edited_copy_of_a_map_wins_over_the_shipped_one(tmp_path: Path) -> None:
    copy_shipped(tmp_path)
    edited = tmp_path / "maps" / "io_node.yaml"
    edited.write_text(edited.read_text().replace("device: generic I/O node", "device: mine"))
    daq = load_rig("emulated", base=tmp_path).drivers[0]
    assert daq.options.map.device == "mine"


def test_a_dbc_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pump.dbc").write_text("not a database")
    with pytest.raises(ConfigError, match=r"pump.dbc:1:1 DBC: cannot be parsed: "):
        check(tmp_path / "pump.dbc")
    shipped = shipped_config_dir() / "dbc" / "pump_unit.dbc"
    assert "PumpStatus" in str(check(shipped))
