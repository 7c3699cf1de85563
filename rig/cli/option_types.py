"""Command-line values that click lacks, numbers without NaN and UTF-8 text, and shared options."""

from collections.abc import Callable
from math import isnan
from typing import Any, Final

import click


class Range(click.FloatRange):
    """A range of numbers that refuses NaN, which click's own accepts."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number; fail with click's message if it is NaN, no number, or out of range."""
        number = float(super().convert(value, param, ctx))
        if isnan(number):
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return number


def text(value: str) -> str:
    """Return the text of an argument or option unchanged, once it is known to be valid UTF-8.

    Raises:
        click.BadParameter: the text holds lone surrogates, which Python has put in the place of
            bytes that are not UTF-8.
    """
    try:
        value.encode()
    except UnicodeEncodeError:
        shown = value.encode(errors="replace").decode()
        raise click.BadParameter(f"{shown}: is no UTF-8; write it in UTF-8") from None
    return value


def paced(begin: str, end: str = "") -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds the option --pace, real or fast, to a command.

    Args:
        begin: beginning of the option's help, such as "At", before "the wall clock".
        end: end of the help, which begins with a space; empty for none.
    """
    words = f"{begin} the wall clock, or as fast as it can; the rig's own if not given.{end}"
    return click.option("--pace", type=click.Choice(["real", "fast"]), help=words)


STREAMED: Final[Callable[[Callable[..., Any]], Callable[..., Any]]] = click.option(
    "--stream",
    "profile",
    metavar="PROFILE",
    help="Live stream by this profile, a file or a shipped name, or off. Default: loopback at the "
    "wall clock, off otherwise.",
)
"""Decorator that adds the option --stream to a command which drives a rig."""
