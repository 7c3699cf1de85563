"""A path that no file can have is bad input for every command, and no traceback."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.recording import Recording, export
from tests.rig.recording.conftest import healthy  # noqa: F401 (a fixture)

Invoke = Callable[..., Any]

COMMANDS = [
    ("check",), ("run",), ("replay",), ("replay", "--columns"), ("replay", "--baseline"),
    ("replay", "--model"), ("export",), ("recover",), ("runs", "show"), ("control",),
]  # fmt: skip
PATHS = {
    "too long": "a" * 300 + ".yaml",
    "a loop": "/proc/self/cwd/" * 60 + "x.yaml",
    "no UTF-8": "a\udcffb.yaml",
    "a device": "/dev/zero",
}


@pytest.mark.parametrize("path", PATHS.values(), ids=PATHS.keys())
def test_a_path_that_no_file_can_have_is_bad_input(
    invoke: Invoke,
    tmp_path: Path,
    path: str,
    healthy: Recording,  # noqa: F811
) -> None:
    export(healthy, tmp_path / "run.csv")
    further = {
        "export": ["out.csv"], "recover": ["out.mcap"], "control": ["status"],
    }  # fmt: skip
    for command in COMMANDS:
        option = command[-1].startswith("--")
        before = ["run.csv"] if option else []
        arguments = [*command[:1], *before, *command[1:], path, *further.get(command[0], [])]
        done = invoke(*arguments)
        assert done.code == 2, (command, done)
        assert "raceback" not in done.err, command
        assert done.err.strip(), command


def test_an_export_to_csv_says_that_it_has_no_checksum(
    invoke: Invoke,
    tmp_path: Path,
    healthy: Recording,  # noqa: F811
) -> None:
    export(healthy, tmp_path / "run.parquet")
    assert "a CSV has no checksum" in invoke("export", "run.parquet", "out.csv").err
    assert invoke("export", "run.parquet", "out.csv.gz").err == ""
    assert invoke("export", "run.parquet", "out.mcap").err == ""
