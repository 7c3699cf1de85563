"""Types of values on the command line that click does not have."""

from math import isnan
from typing import Any, Final

import click


class Range(click.FloatRange):
    """A range of numbers that refuses NaN, which click's own accepts."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number; fail with click's message if it is none, or outside the range."""
        number = float(super().convert(value, param, ctx))
        if isnan(number):
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return number


class _Text(click.ParamType[str]):
    """A text that is kept in records and shown to others; bytes that are no UTF-8 are refused."""

    name = "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the text; in it, bytes that are no UTF-8 have become lone surrogates."""
        text = str(value)
        try:
            text.encode()
        except UnicodeEncodeError:
            shown = text.encode(errors="replace").decode()
            self.fail(f"{shown}: is no UTF-8; write it in UTF-8", param, ctx)
        return text


TEXT: Final = _Text()
