"""Types of command-line values that click lacks: numbers without NaN, and UTF-8 text."""

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


class _Text(click.ParamType[str]):
    """A text that is recorded and shown to others; it is refused if its bytes are not UTF-8."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text, or fail if it holds lone surrogates.

        Python has put these in the place of bytes that are not UTF-8.
        """
        text = str(value)
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = text.encode(errors="replace").decode()
            self.fail(f"{shown}: is no UTF-8; write it in UTF-8", param, ctx)
        return text


TEXT: Final = _Text()
