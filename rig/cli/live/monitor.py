"""`rig monitor` shows the live streams of rigs in the terminal."""

import json
import time
from typing import TYPE_CHECKING, Final

import click
from rich.console import Group
from rich.live import Live

from rig.cli.application import EXIT_BAD_INPUT, EXIT_STOPPED, ending
from rig.cli.option_types import TEXT
from rig.cli.screen import Screen
from rig.configuration import load_stream
from rig.stream import COMMANDS, CommandName

from .following import endpoints, follows_streams
from .monitor_view import document, line, screen

if TYPE_CHECKING:
    from rig.stream import Snapshot, StreamClient

SCREEN_S: Final = 0.1
LOG_S: Final = 1.0
EXIT_DEAD: Final = 1


@click.command()
@click.option(
    "--rig", "rig_id", default="*", type=TEXT, metavar="ID", help="One rig; all if not given."
)
@follows_streams
@click.option("--once", is_flag=True, help="Show what there is, once, and end; 1 if nothing lives.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a rig and line.")
@click.option(
    "--wait", "wait_s", default=5.0, metavar="SECONDS", help="How long --once waits for a rig."
)
@click.option(
    "--send", "order", type=click.Choice(COMMANDS),
    help="Send a command instead; see docs/stream.md for each. 1 if it is not obeyed.",
)  # fmt: skip
@click.option("--text", default="", type=TEXT, help="A remark that is recorded with the command.")
@click.option("--test", default="", type=TEXT, metavar="NAME", help="The test to skip or to retry.")
def command(
    rig_id: str,
    connect: tuple[str, ...],
    profile: str,
    once: bool,
    as_json: bool,
    wait_s: float,
    order: CommandName | None,
    text: str,
    test: str,
) -> int:
    """Watch rigs that run, live: rates, lateness, pressures, residual and threshold, verdict.

    On a terminal the screen is updated until Ctrl-C; elsewhere a line is written each second for
    each rig. A stream that has died is shown as dead, with the time since its last message.
    """
    settings = load_stream(profile)
    where = endpoints(connect)
    from rig.stream import KeyFileError, StreamClient, StreamError, UnknownRigError

    try:
        with (
            ending(EXIT_BAD_INPUT, KeyFileError, StreamError, UnknownRigError),
            StreamClient(settings, where, rig=rig_id) as client,
        ):
            if once or order:
                _await(client, wait_s)
            if order is not None:
                answer = client.send(order, None if rig_id == "*" else rig_id, text, test=test)
                click.echo(f"{order}: {'obeyed' if answer.accepted else answer.reason}")
                return 0 if answer.accepted else EXIT_DEAD
            if once:
                return _once(client, as_json)
            return _follow(client, as_json)
    except BrokenPipeError:
        return EXIT_STOPPED


def _await(client: "StreamClient", wait_s: float) -> None:
    """Wait until a rig is alive and has sent its health; give up after `wait_s`."""
    until = time.monotonic() + wait_s
    while time.monotonic() < until:
        living = [shot.rig for shot in _snapshots(client) if shot.alive and shot.health]
        if living:
            for rig in living:
                client.history(1.0, rig)
            return
        time.sleep(SCREEN_S)


def _snapshots(client: "StreamClient") -> "list[Snapshot]":
    return [client.snapshot(rig) for rig in client.rigs()]


def _once(client: "StreamClient", as_json: bool) -> int:
    found = _write(client, as_json)
    if not found:
        click.echo("no rig is heard of; is one running, and with a stream?", err=True)
    return 0 if any(snapshot.alive for snapshot in found) else EXIT_DEAD


def _write(client: "StreamClient", as_json: bool) -> "list[Snapshot]":
    """Write a line for each rig, and return the rigs' snapshots."""
    found = _snapshots(client)
    for shot in found:
        click.echo(json.dumps(document(shot), allow_nan=False) if as_json else line(shot))
    return found


def _follow(client: "StreamClient", as_json: bool) -> int:
    console = Screen()
    try:
        if console.is_terminal and not as_json:
            with Live(console=console, screen=True, auto_refresh=False) as live:
                while True:
                    shown = [screen(snapshot) for snapshot in _snapshots(client)]
                    live.update(Group(*(shown or ["waiting for a rig ..."])), refresh=True)
                    time.sleep(SCREEN_S)
        while True:
            _write(client, as_json)
            time.sleep(LOG_S)
    except KeyboardInterrupt:
        return 0
