"""`rig router` passes the live streams of many rigs on to the programs that follow them."""

import threading

import click

from rig.cli.application import EXIT_BAD_INPUT, ending
from rig.configuration import load_stream
from rig.runner import StopFlag, stop_on_signals


@click.command()
@click.argument("profile", default="router")
def command(profile: str) -> int:
    """Route streams by PROFILE, a file or a shipped name, until Ctrl-C.

    Rigs connect to the router by the profile `fleet`, and so do monitors and consoles. Eclipse's
    zenohd with the same addresses, certificates and access control can be used in its place.
    """
    settings = load_stream(profile)
    from rig.stream import StreamError, check_files, publisher_session

    stop = StopFlag()
    with ending(EXIT_BAD_INPUT, StreamError):
        check_files(settings)
        with publisher_session(settings), stop_on_signals(stop):
            click.echo(f"routes on {', '.join(map(str, settings.listen))}")
            while not stop.requested:
                threading.Event().wait(0.2)
    return 0
