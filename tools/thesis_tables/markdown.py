"""Figures and tables as GitHub's Markdown."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from typing import Final

from .measures import Change, Coefficient

NOTHING: Final = "–"
_PLAIN: Final = range(-4, 5)
"""Powers of ten that a figure is written out for, without an exponent."""
_LEAST_AT_TWO_DECIMALS: Final = 0.005


def figure(value: float | None, digits: int = 2) -> str:
    """Return a value with so many significant digits, one more from 10^digits on."""
    if value is None:
        return NOTHING
    if not isfinite(value):
        return "not finite"
    if value == 0.0:
        return "0"
    if abs(value) >= 10.0**digits:
        digits += 1
    exponent = floor(log10(abs(float(f"{value:.{digits - 1}e}"))))
    if exponent not in _PLAIN:
        return f"{value / 10.0**exponent:.{digits - 1}f}e{exponent}"
    rounded = round(value, digits - 1 - exponent)
    return f"{rounded:.{max(digits - 1 - exponent, 0)}f}"


def fixed(value: float | None, decimals: int) -> str:
    """Return a value with so many decimals; a dash for None."""
    # Adding zero turns -0.0 into 0.0.
    return NOTHING if value is None else f"{round(value, decimals) + 0.0:.{decimals}f}"


def arrow(change: Change, unit: float = 1.0, decimals: int | None = None) -> str:
    """Return "before → after", or the one there is, in a unit; 2 digits, or so many decimals."""
    texts = [
        figure(value / unit) if decimals is None else fixed(value / unit, decimals)
        for value in change
        if value is not None
    ]
    return " → ".join(texts) or NOTHING


def spread(coefficient: Coefficient | None, unit: float) -> str:
    """Return "mean ± deviation" in a unit; a dash for None, the mean alone if it was set."""
    if coefficient is None:
        return NOTHING
    mean = fixed(coefficient.mean / unit, 2)
    if coefficient.deviation == 0.0:
        return mean
    deviation = coefficient.deviation / unit
    return f"{mean} ± {fixed(deviation, 2 if deviation >= _LEAST_AT_TWO_DECIMALS else 3)}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table: first column to the left, the others to the middle.

    Raises:
        ValueError: a row is not as long as the head.
    """
    lines = [head, [":--", *[":-:"] * (len(head) - 1)]]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"row of {len(row)} cells in a table of {len(head)} columns: {row}")
        lines.append(row)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def heading_row(text: str, columns: int) -> list[str]:
    """Return a row that only names what stands below it."""
    return [f"**{text}**", *[""] * (columns - 1)]
