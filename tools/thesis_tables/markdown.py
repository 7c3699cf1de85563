"""Formats figures and tables as GitHub's Markdown."""

from collections.abc import Iterable, Sequence
from math import floor, isfinite, log10
from typing import Final

from .measures import Change, Coefficient

NOTHING: Final = "–"
_PLAIN: Final = range(-4, 5)
"""Exponents of ten with which a figure is written as a plain decimal number."""
_LEAST_AT_TWO_DECIMALS: Final = 0.005


def figure(value: float | None, digits: int = 2) -> str:
    """Return a value as text with `digits` significant digits, or one more from 10^digits on.

    None gives a dash; an infinite value or NaN gives "not finite". A magnitude below 1e-4, or from
    1e5 on, is written with an exponent of ten, such as "1.2e-5".
    """
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
    """Return a value as text with `decimals` decimals; a dash for None."""
    # Adding zero turns -0.0 into 0.0.
    return NOTHING if value is None else f"{round(value, decimals) + 0.0:.{decimals}f}"


def arrow(change: Change, unit: float = 1.0, decimals: int | None = None) -> str:
    """Return the text "before → after" of a change, or only the value that is not None.

    If both are None, it is a dash.

    Args:
        change: the values before and after.
        unit: unit that they are divided by.
        decimals: number of decimals; None means 2 significant digits.
    """
    texts = [
        figure(value / unit) if decimals is None else fixed(value / unit, decimals)
        for value in change
        if value is not None
    ]
    return " → ".join(texts) or NOTHING


def spread(coefficient: Coefficient | None, unit: float) -> str:
    """Return the text "mean ± deviation" of a coefficient, divided by `unit`.

    Both have 2 decimals, a deviation below 0.005 units has 3. None gives a dash. If the deviation
    is 0, because the coefficient was set, the mean alone is returned.
    """
    if coefficient is None:
        return NOTHING
    mean = fixed(coefficient.mean / unit, 2)
    if coefficient.deviation == 0.0:
        return mean
    deviation = coefficient.deviation / unit
    return f"{mean} ± {fixed(deviation, 2 if deviation >= _LEAST_AT_TWO_DECIMALS else 3)}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown; the first column is left-aligned, the others are centred.

    Raises:
        ValueError: a row has not as many cells as the head.
    """
    lines = [head, [":--", *[":-:"] * (len(head) - 1)]]
    for row in rows:
        if len(row) != len(head):
            raise ValueError(f"row of {len(row)} cells in a table of {len(head)} columns: {row}")
        lines.append(row)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def heading_row(text: str, columns: int) -> list[str]:
    """Return a row of `columns` cells: first a heading for the rows below, in bold, then empty."""
    return [f"**{text}**", *[""] * (columns - 1)]
