"""Ranges of numbers given on the command line."""

from math import isnan
from typing import Any

import click


class Range(click.FloatRange):
    """A range that NaN is not in: click compares, and no comparison refuses NaN."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        """Return the number; fails with click's message if it is outside the range or none."""
        number = float(super().convert(value, param, ctx))
        if isnan(number):
            self.fail(f"{value} is not in the range {self._describe_range()}.", param, ctx)
        return number
