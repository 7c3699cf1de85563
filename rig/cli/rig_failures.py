"""These functions end a command with a message and an exit code if its rig does not run."""

from collections.abc import Iterator
from contextlib import contextmanager

import click

from rig.configuration import Rig
from rig.io import DriverError
from rig.loop import TripError

from .application import EXIT_BAD_INPUT, EXIT_STOPPED, ending


@contextmanager
def failures_reported() -> Iterator[None]:
    """End the command if a driver fails, or the rig trips or is stopped, within the block.

    Raises:
        click.exceptions.Exit: the message is on stderr already. The exit code is `EXIT_BAD_INPUT`
            for a driver, `EXIT_STOPPED` for a trip or a stop.
    """
    with ending(EXIT_BAD_INPUT, DriverError), ending(EXIT_STOPPED, TripError, before="rig: "):
        yield


def require_possible_pace(rig: Rig, pace: str | None) -> None:
    """End the command if it asks a hardware rig to run as fast as it can.

    Raises:
        click.exceptions.Exit: the message is on stderr already; the code is `EXIT_BAD_INPUT`.
    """
    if rig.backend == "hardware" and pace == "fast":
        limit = f"the rig {rig.name} is hardware, which runs at the wall clock"
        click.echo(f"--pace fast: {limit}; leave the option out", err=True)
        raise click.exceptions.Exit(EXIT_BAD_INPUT)
