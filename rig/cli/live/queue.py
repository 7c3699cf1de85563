"""`rig queue` edits the queue of campaigns that the operator's console starts."""

import json
import time
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path

import click

from rig.cli.application import EXIT_BAD_INPUT, ending
from rig.cli.option_types import text
from rig.console import Queued, QueueError, QueueFile
from rig.control_socket import own_name

_runs = click.option(
    "--runs", type=click.Path(path_type=Path, file_okay=False), default=Path("runs"),
    show_default=True, metavar="DIR", help="The console's folder, as of its --runs.",
)  # fmt: skip
_number = click.argument("number", type=click.IntRange(min=1))


@click.group()
def command() -> None:
    """Edit the queue of campaigns that `rig console` starts one after another.

    The queue is in the folder of the console's --runs, and a console that runs shows a change
    within a second. Only the console starts what is queued, once somebody has pressed `Start the
    queue` on its page. Exit code: 0 if it was done, 2 if not, with the reason.
    """


@command.command("list")
@click.option("--json", "as_json", is_flag=True, help="As one JSON list.")
@_runs
def list_queue(as_json: bool, runs: Path) -> int:
    """Show what waits, the next one first: number, campaign, who queued it and when (UTC)."""
    with ending(EXIT_BAD_INPUT, QueueError, before="queue: "):
        file = QueueFile(runs)
        entries = file.read().entries
        if as_json:
            click.echo(json.dumps([asdict(each) for each in entries], ensure_ascii=False))
        else:
            _show(file, entries)
    return 0


@command.command()
@click.argument("campaign", type=text)
@click.option(
    "--by", default="", type=text, metavar="NAME", help="Who queues it; your user if not given."
)
@_runs
def add(campaign: str, by: str, runs: Path) -> int:
    """Add CAMPAIGN, by the name under which the console offers it, at the end."""
    with ending(EXIT_BAD_INPUT, QueueError, before="queue: "):
        file = QueueFile(runs)
        if not file.read().offered:
            remedy = "start `rig console` with this --runs first"
            raise QueueError(f"{runs}: no console has offered campaigns here; {remedy}")
        _show(file, file.add(campaign, by or own_name()).entries)
    return 0


@command.command()
@_number
@click.argument("way", type=click.Choice(["earlier", "later", "first"]))
@_runs
def move(number: int, way: str, runs: Path) -> int:
    """Move the entry NUMBER one place earlier or later, or to be the first."""
    with ending(EXIT_BAD_INPUT, QueueError, before="queue: "):
        file = QueueFile(runs)
        _show(file, file.move(number, way).entries)  # type: ignore[arg-type]
    return 0


@command.command()
@_number
@_runs
def remove(number: int, runs: Path) -> int:
    """Take the entry NUMBER out of the queue."""
    with ending(EXIT_BAD_INPUT, QueueError, before="queue: "):
        file = QueueFile(runs)
        _show(file, file.remove(number).entries)
    return 0


def _show(file: QueueFile, entries: Iterable[Queued]) -> None:
    entries = list(entries)
    for each in entries:
        at = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(each.at_ms / 1e3))
        began = "  was about to be started when the console ended" if each.is_begun else ""
        click.echo(f"{each.number:4} {each.campaign}, queued by {each.by} at {at}{began}")
    if not entries:
        click.echo(f"{file.path}: the queue is empty")
