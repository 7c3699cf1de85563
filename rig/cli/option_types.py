"""Command-line values that click lacks, numbers without NaN and UTF-8 text, and shared options."""

from collections.abc import Callable
from math import isnan
from typing import Any

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
    """Return a text that is recorded and shown to others.

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
    """Return the option --pace, real or fast, whose help has `begin` and `end` around it."""
    words = f"{begin} the wall clock, or as fast as it can; the rig's own if not given.{end}"
    return click.option("--pace", type=click.Choice(["real", "fast"]), help=words)
