"""Options of the commands that follow live streams: where the rigs are, and whose keys count."""

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
    """Give a command the options --connect (texts) and --profile."""
    return _CONNECT(_PROFILE(command))


def endpoints(texts: Sequence[str]) -> tuple[Endpoint, ...]:
    """Return the endpoints that --connect names.

    Raises:
        ConfigError: every text that names no endpoint.
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
