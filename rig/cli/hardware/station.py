"""`rig station` owns a rig from power-on to power-off, and lends it to what drives it."""

import json
import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final

import click

from rig.cli.live_stream import stream_of, streamed
from rig.cli.option_types import STREAMED
from rig.cli.rig_failures import failures_reported
from rig.cli.screen import Screen
from rig.configuration import Rig, load_model, load_rig
from rig.control_socket import own_name
from rig.io import in_use
from rig.runner import Observer, StopFlag, stop_on_signals
from rig.runner.run_folder import file_stem
from rig.runner.station import WATCH, Obey, Resident, StationLog
from rig.stream import StreamSettings
from rig.supervisor import Errand, Keeper, Onlooker, word_of_station
from rig.surviving import Surviving

Say = Callable[[str], None]
EXIT_NONE: Final = 1
EXIT_NO_DEVICES: Final = 3
UNIT: Final = """\
# Written by: rig station {rig} --unit
# Copy it to ~/.config/systemd/user/rig-station.service; then
#     systemctl --user daemon-reload && systemctl --user enable --now rig-station
# and, so that it runs without a login: loginctl enable-linger
[Unit]
Description=Station of the rig {name}
After=network-online.target

[Service]
WorkingDirectory={folder}
ExecStart={command}
# SIGTERM leaves the rig safe, within 20 s for slow drivers and 10 s for the loop.
TimeoutStopSec=60
KillMode=mixed
Restart=always
RestartSec=2

[Install]
WantedBy=default.target
"""
"""A systemd unit of the user that may reach the rig's devices."""


@click.command()
@click.argument("reference", metavar="RIG")
@click.option("--model", default="nominal", show_default=True, help="What is assumed of the rig.")
@click.option(
    "--runs",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("runs"),
    show_default=True,
    help="The station's own folder, station-RIG, is made below this one.",
)
@STREAMED
@click.option("--status", is_flag=True, help="Show what the rig's station does, and end.")
@click.option("--json", "as_json", is_flag=True, help="With --status: one object.")
@click.option("--unit", is_flag=True, help="Print a systemd unit that runs this station, and end.")
def command(
    reference: str,
    model: str,
    runs: Path,
    profile: str | None,
    status: bool,
    as_json: bool,
    unit: bool,
) -> int:
    """Own RIG, on hardware, until Ctrl-C or SIGTERM: read it, and lend it to who drives it.

    While nothing drives, the rig is disarmed, its pump unloaded and its valve at null; readings,
    checks and interlocks are live on the live stream. A command that drives the rig asks the
    station for it by itself; another one is refused meanwhile. What happens is kept in
    station.jsonl below --runs, and no recording is made. Devices that are lost are tried again.
    Exit code: 0 ended and safe, 2 bad input or there is a station already, 3 not safe.
    With --status: 0 there is a station, 1 there is none, 3 it cannot read the rig.
    """
    if as_json and not status:
        raise click.UsageError("--json: goes with --status")
    if status and unit:
        raise click.UsageError("--status and --unit: give one of them")
    rig = load_rig(reference)
    if rig.backend != "hardware":
        needed = "a station owns devices; give a rig with `backend: hardware`"
        raise click.BadParameter(f"{rig.name} has none: {needed}", param_hint="RIG")
    if status:
        with failures_reported():
            return _show_status(rig, as_json=as_json)
    if unit:
        click.echo(_unit(rig, reference, model, runs, profile), nl=False)
        return 0
    assumed, settings = load_model(model), stream_of(profile, paced=True)
    folder = runs / f"station-{file_stem(rig.name)}"
    screen, stop = Screen(), StopFlag()
    log_of = _said_by(screen)
    socket = Surviving("the station's socket", log_of)
    with failures_reported(), stop_on_signals(stop), Keeper(rig, socket) as keeper:
        folder.mkdir(parents=True, exist_ok=True)
        log = StationLog(folder, log_of)

        def watched(obey: Obey) -> AbstractContextManager[tuple[Say, Onlooker]]:
            return _stream(settings, rig, folder, obey)

        Resident(rig, assumed, folder, keeper, stop, log, watched).run()
    return 0


class _Watching(Onlooker):
    """The onlooker of an idle session without a live stream."""

    @property
    def errand(self) -> Errand:
        """The station's own errand, for which it asks nobody."""
        return Errand(WATCH, own_name(), of_station=True)


@contextmanager
def _stream(
    settings: StreamSettings | None, rig: Rig, folder: Path, obey: Obey
) -> Iterator[tuple[Say, Onlooker]]:
    """Open the live stream of an idle session, if there are settings for one."""
    if settings is None:
        yield lambda text: None, _Watching()
        return
    context = streamed(
        Observer(), settings, rig, folder, obey, paced=True, by=own_name(), activity=WATCH,
        idle=True,
    )  # fmt: skip
    with context as run:
        yield run.rig_tells, run


def _said_by(screen: Screen) -> Say:
    return lambda text: screen.print(text, soft_wrap=True)


def _show_status(rig: Rig, *, as_json: bool) -> int:
    """Show what the rig's station tells of itself; return the exit code.

    Raises:
        DriverError: the station does not answer, or is of another version.
    """
    found = word_of_station(rig)
    if as_json:
        click.echo(json.dumps(found))
    elif found is None:
        # Another user's station is not found by its socket, but the devices that it reads are.
        used = in_use(rig.drivers)
        remedy = used or "start one: rig station RIG"
        click.echo(f"{rig.name}: no station of this user; {remedy}")
    else:
        click.echo(
            f"{rig.name}: station is process {found['pid']}, version {found['version']}, since "
            f"{found['since']}\nstate: {found['text']}\n"
            f"devices: {', '.join(found['devices'])}"
        )
    if found is None:
        return EXIT_NONE
    return EXIT_NO_DEVICES if found["state"] == "no devices" else 0


def _unit(rig: Rig, reference: str, model: str, runs: Path, profile: str | None) -> str:
    """Return the text of a systemd unit that runs this station from this folder."""
    program = Path(sys.argv[0]).absolute()
    start = [str(program)] if program.name == "rig" else [sys.executable, "-m", "rig.cli"]
    given = ["station", reference, "--model", model, "--runs", str(runs)]
    given += [] if profile is None else ["--stream", profile]
    # In a unit a percent sign begins a specifier, and is written twice to mean itself.
    words = shlex.join([*start, *given]).replace("%", "%%")
    folder = str(Path.cwd()).replace("%", "%%")
    return UNIT.format(rig=reference, name=rig.name, folder=folder, command=words)
