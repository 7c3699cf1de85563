"""What docs/emulator.md shows works."""

import re
from pathlib import Path
from typing import Final

import pytest

from rig.emulator.instruments import CHANNELS
from rig.emulator.running import EmulatorThread
from rig.emulator.script.fault_script import read_script
from rig.emulator.script.wire_faults import KINDS

PAGE: Final = (Path(__file__).parents[4] / "docs" / "emulator.md").read_text()
PYTHON: Final = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_it_tells_of_every_fault_and_every_channel() -> None:
    told = set(re.findall(r"`(\w+)`", PAGE)) | set(re.findall(r"\w+", PAGE))
    assert KINDS.keys() <= told
    assert set(CHANNELS) <= told


def test_its_script_is_valid(tmp_path: Path) -> None:
    examples = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (example,) = (each for each in examples if "faults:" in each)
    path = tmp_path / "script.yaml"
    path.write_text(example)
    script = read_script(path)
    assert [fault.kind for fault in script.faults] == ["delay", "sensor", "estop"]
    assert script.attentive


def test_its_controller_moves_the_ram(
    emulator: EmulatorThread, capsys: pytest.CaptureFixture[str]
) -> None:
    code = PYTHON[0].replace("15502", str(emulator.ports["daq"])).replace("2000", "900")
    exec(compile(code, "docs/emulator.md", "exec"), {})
    millimetres = float(capsys.readouterr().out.split()[0])
    assert millimetres > 10.0


def test_its_python_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(PYTHON[1], "docs/emulator.md", "exec"), {})
    assert int(capsys.readouterr().out.split()[0]) > 0
