"""`rig emulate` serves an emulated rig over the protocols of a real one."""

import asyncio
import json
import os
import signal
from pathlib import Path
from typing import Final

import click

from rig.cli.first_compiling import first_compiling
from rig.configuration import Physical, QuantityError, Rig, load_rig
from rig.emulator import ATTENTIVE, Emulator, Record, endpoints_of, raise_priority, read_script
from rig.io import DriverError

_SHOWN: Final = {
    "daq": "I/O device, Modbus/TCP",
    "bypass": "bypass valves, Modbus",
    "drive": "servovalve, CAN",
    "pump": "pump unit, CAN",
    "meters": "flow meters, serial",
    "control": "control port, JSON lines on TCP",
    "reset": "reset button",
}
_PRIORITY: Final = {True: "real-time", False: "ordinary"}
_PRESSES: Final = {True: "somebody presses it when its lamp is lit", False: "nobody presses it"}

_LAST_PORT: Final = 65535
_FILE: Final = click.Path(path_type=Path, dir_okay=False)


def _ports(
    context: click.Context, option: click.Parameter, values: tuple[str, ...]
) -> dict[str, int]:
    """Return the port of each driver that the texts NAME=PORT give; the last one of a name counts.

    Raises:
        click.BadParameter: a text is not of this form, or its port is out of range.
    """
    ports = {}
    for value in values:
        name, _, port = value.partition("=")
        if not name or not port.isascii() or not port.isdigit() or int(port) > _LAST_PORT:
            raise click.BadParameter(f"{value}; write daq=15502, or daq=0 for any free port")
        ports[name] = int(port)
    return ports


def _position(text: str, rig: Rig) -> float:
    """Return the position in m that a text gives.

    Raises:
        click.BadParameter: the text is no position, or lies beyond the stroke.
    """
    par = rig.plant.parameters
    try:
        return Physical("m", par.stroke_min, par.stroke_max).parse(text)
    except QuantityError as error:
        raise click.BadParameter(f"{text} {error}", param_hint="--start") from error


@click.command()
@click.argument("rig_reference", metavar="[RIG]", default="emulated")
@click.option(
    "--script",
    type=_FILE,
    default=ATTENTIVE,
    metavar="FILE",
    help="What happens by itself (YAML): faults, and whether somebody presses the reset button "
    "when its lamp is lit. If not given, somebody does, and nothing fails.",
)
@click.option(
    "--record",
    type=_FILE,
    metavar="FILE",
    help="Append what it receives to this file, one JSON object a line.",
)
@click.option(
    "--trace", type=_FILE, metavar="FILE", help="Write every valve command to this CSV file."
)
@click.option(
    "--control",
    type=click.IntRange(0, _LAST_PORT),
    metavar="PORT",
    help="Take orders as JSON lines on this TCP port; 0: any free one.",
)
@click.option(
    "--set-port",
    "ports",
    callback=_ports,
    multiple=True,
    metavar="NAME=PORT",
    help="Serve the device of this driver on another port than the rig file's; 0: any free one.",
)
@click.option("--seed", default=0, show_default=True, help="Fixes the sensors' noise.")
@click.option(
    "--start",
    metavar="POSITION",
    help="Where the ram rests at first, such as '0.1 m'; mid stroke if not given.",
)
@click.option(
    "--priority/--no-priority",
    default=True,
    help="Whether to answer ahead of ordinary programs where the system grants it; it does.",
)
@click.option("--json", "as_json", is_flag=True, help="Say what is served where in JSON.")
def command(
    rig_reference: str,
    script: Path,
    record: Path | None,
    trace: Path | None,
    control: int | None,
    ports: dict[str, int],
    seed: int,
    start: str | None,
    priority: bool,
    as_json: bool,
) -> None:
    """Serve an emulated RIG, a file or a shipped name, until Ctrl-C.

    Its devices are served at the addresses in the rig file, where the rig's drivers look for them.
    Exit code 0 when stopped, 2 on bad input, such as a port in use.
    """
    rig = load_rig(rig_reference)
    position = None if start is None else _position(start, rig)
    endpoints = endpoints_of(rig, ports, control)
    played = read_script(script)
    try:
        written = Record(record, trace)
    except OSError as error:
        raise click.FileError(str(error.filename), hint=error.strerror) from error

    async def serve() -> dict[str, int]:
        with first_compiling("emulated plant", silent=as_json):
            emulator = Emulator(
                rig, endpoints, written, script=played, seed=seed, position=position
            )
        await emulator.open()
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, emulator.stop)
        granted = priority and raise_priority()
        if as_json:
            told = {"ready": True, "ports": emulator.ports, "pid": os.getpid()}
            click.echo(json.dumps(told))
        else:
            click.echo(f"emulated rig {rig.name}, at {_PRIORITY[granted]} priority")
            for part, where in {**emulator.ports, "reset": _PRESSES[played.attentive]}.items():
                click.echo(f"  {_SHOWN[part]:32} {where}")
            click.echo("Ctrl-C ends it")
        await emulator.run()
        await emulator.close()
        return emulator.summary()

    try:
        summary = asyncio.run(serve())
    except DriverError as error:
        raise click.ClickException(str(error)) from error
    finally:
        written.close()
    if as_json:
        click.echo(json.dumps({"ended": True, **summary}))
    else:
        click.echo("ended: " + ", ".join(f"{value} {name}" for name, value in summary.items()))
