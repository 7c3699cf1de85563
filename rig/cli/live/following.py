"""Options of the commands that follow live streams: addresses of the rigs, and the profile."""

from collections.abc import Callable, Sequence
from typing import Any

import click

from rig.configuration import DEFAULT, ConfigError, Problem
from rig.stream import Endpoint

_CONNECT = click.option(
    "--connect", multiple=True, metavar="ENDPOINT",
    help="Where rigs or their router are (tls/rig.example:7447), if not where the profile says.",
)  # fmt: skip
_PROFILE = click.option(
    "--profile", default=DEFAULT, metavar="PROFILE",
    help="The stream's profile, a file or a shipped name, with the certificates of this end.",
)  # fmt: skip


def follows_streams(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command with the options --connect (any number of texts) and --profile added."""
    return _CONNECT(_PROFILE(command))


def endpoints(texts: Sequence[str]) -> tuple[Endpoint, ...]:
    """Return the endpoints that the texts of --connect name.

    Raises:
        ConfigError: lists every text that is not an endpoint.
    """
    problems, found = [], []
    for text in texts:
        try:
            found.append(Endpoint.parse(text))
        except ValueError as error:
            remedy = "write like tcp/127.0.0.1:7447 or tls/rig.example:7447"
            problems.append(Problem("--connect", 0, 0, "endpoint", text, str(error), remedy))
    if problems:
        raise ConfigError(problems)
    return tuple(found)
