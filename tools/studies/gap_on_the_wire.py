"""Hides effects in an emulated rig and runs `rig gap --live` on it over the wire.

The emulator is a process of its own, reached by Modbus, CAN and a serial line. The command gets the
rig's addresses and the nominal model, but not the effects. It runs in real time; with the default
programme the ram moves for about four minutes.

    python -m tools.studies.gap_on_the_wire command_delay="3 ms" --out runs/gap-on-the-wire
"""

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Final

import click
import yaml

ROOT: Final = Path(__file__).parents[2]
_PATIENCE_S: Final = 60.0
_STOPPED: Final = {
    "stale_limit": "5 s",
    "loop_silence": "10 s",
    "field_silence": "10 s",
    "supervisor_silence": "10 s",
    "recorder_silence": "30 s",
}
"""Longer limits than on a real rig, because a virtual machine may stop for a moment. Emulator and
programs then stop together, so that the ram has not moved meanwhile; a real ram would have."""


def emulated_rig(effects: dict[str, str], folder: Path) -> dict[str, Any]:
    """Return the shipped emulated rig, with effects added to its nominal plant and free addresses.

    Args:
        effects: size of each effect with its unit, by name.
        folder: for the file that stands for the serial line; nothing is written to it here.
    """
    rig: dict[str, Any] = yaml.safe_load((ROOT / "config" / "rigs" / "emulated.yaml").read_text())
    rig["plant"] = {"model": "nominal", "effects": effects}
    drivers = rig["drivers"]
    drivers["daq"]["port"], drivers["bypass"]["port"], bus = _free_ports(3)
    drivers["meters"]["port"] = str(folder / "meters")
    for node in ("drive", "pump"):
        drivers[node] |= {"channel": "239.74.163.97", "port": bus, "silence": "5 s"}
    rig["loop"] |= _STOPPED
    drivers["daq"]["watchdog"], drivers["bypass"]["watchdog"] = "1 s", "5 s"
    drivers["drive"]["watchdog"] = "12 s"
    drivers["meters"]["stale"] = "5 s"
    return rig


def close_on_wire(effects: dict[str, str], folder: Path, *options: str) -> dict[str, Any]:
    """Run the emulator, and `rig gap --live --json` on it; return the object that it prints.

    Args:
        effects: size of each hidden effect with its unit, by name.
        folder: an existing folder. The rig's file is written to it, and the command writes its
            files to `found` in it.
        options: further options of the command.

    Raises:
        click.ClickException: the emulator did not start, or the command failed.
    """
    rig = folder / "rig.yaml"
    rig.write_text(yaml.safe_dump(emulated_rig(effects, folder)))
    with ExitStack() as ends:
        emulator = _python("emulate", str(rig), "--json", output=subprocess.PIPE)
        ends.callback(emulator.wait, _PATIENCE_S)
        ends.callback(emulator.send_signal, signal.SIGTERM)
        assert emulator.stdout is not None
        ends.enter_context(emulator.stdout)
        ready = emulator.stdout.readline()
        if not ready.startswith("{"):
            raise click.ClickException(f"the emulator did not start: {ready}")
        asked = ("gap", "--live", "--rig", str(rig), "--out", str(folder / "found"), "--json")
        command = _python(*asked, *options, output=subprocess.PIPE)
        printed, _ = command.communicate()
    if command.returncode != 0:
        raise click.ClickException(f"rig gap ended with {command.returncode}: {printed}")
    found: dict[str, Any] = json.loads(printed.splitlines()[-1])
    return found


def _python(*arguments: str, output: int) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.cli", *arguments],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=output,
        text=True,
    )


def _free_ports(count: int) -> list[int]:
    with ExitStack() as sockets:
        opened = [sockets.enter_context(socket.socket()) for _ in range(count)]
        for each in opened:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in opened]


@click.command()
@click.argument("effects", nargs=-1, metavar="EFFECT=VALUE...")
@click.option("--out", type=click.Path(path_type=Path), required=True, metavar="DIR")
@click.option("--rounds", default=4, show_default=True)
def main(effects: tuple[str, ...], out: Path, rounds: int) -> None:
    """Hide EFFECTs, such as command_delay="3 ms", run `rig gap --live`, and print its answer."""
    out.mkdir(parents=True, exist_ok=True)
    hidden = dict(effect.split("=", 1) for effect in effects)
    found = close_on_wire(hidden, out, "--rounds", str(rounds))
    click.echo(json.dumps({"hidden": hidden, **found}, indent=1))
    report = json.loads((out / "found" / "gap.json").read_text())
    for each in report["rounds"]:
        click.echo(json.dumps({key: each[key] for key in ("round", "why", "motions", "verdict")}))
        click.echo(json.dumps({"check": each["check"]}))


if __name__ == "__main__":
    main()
