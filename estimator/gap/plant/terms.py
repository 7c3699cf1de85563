"""This module lists the terms that may describe an unknown disturbance in symbols.

A term is a function of one region's quantity: the quantity itself, its square, a wave or a bump
along it, and so on. It may be multiplied by the direction of motion or by the time.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import atan2, hypot
from typing import Final

import numpy as np

from .interface import Array, Region

WAVES: Final = 48
"""Number of wave periods that are tried along a length. They are evenly spaced in 1 / period, from
half the range that the motion covers down to SHORTEST_WAVE."""
SHORTEST_WAVE: Final = 5e-3
"""Shortest period that is tried, m. The pitch of a rack, screw or motor is longer."""
BUMPS: Final = 10
DIRECTION: Final = "direction"
TIME_NAME: Final = "time"


@dataclass(frozen=True)
class Term:
    """One term that a disturbance may contain.

    Attributes:
        region: name of the quantity that the term depends on; empty for a constant.
        form: "1", "x", "|x|", "x^2", "x |x|", "wave" or "bump".
        times: factor on the form: "" for none, "direction" or "time".
        at: period of a wave, or middle and width of a bump, SI; empty for other forms.
    """

    region: str
    form: str
    times: str = ""
    at: tuple[float, ...] = ()

    @property
    def columns(self) -> int:
        """Return the number of coefficients: two for a wave, which has a phase, else one."""
        return 2 if self.form == "wave" else 1

    def values(self, along: Mapping[str, Array]) -> Array:
        """Return the term's columns (n, columns), at a coefficient of 1 each.

        `along` holds quantities (n,) by name: at least one, and all that the term `needs`.
        """
        x = along[self.region] if self.region else np.ones(len(next(iter(along.values()))))
        if self.form == "wave":
            phase = 2.0 * np.pi * x / self.at[0]
            shape = np.column_stack([np.sin(phase), np.cos(phase)])
        elif self.form == "bump":
            shape = np.exp(-(((x - self.at[0]) / self.at[1]) ** 2))[:, None]
        else:
            shape = _FORMS[self.form](x)[:, None]
        return np.asarray(shape * along[self.times][:, None] if self.times else shape)

    def needs(self) -> set[str]:
        """Return the names of the quantities that the term depends on, its factor included."""
        return {name for name in (self.region, self.times) if name}

    def unit(self, unit: str, regions: Mapping[str, Region]) -> str:
        """Return the SI unit of the coefficient, if the disturbance has the SI unit `unit`."""
        power = {"x": 1, "|x|": 1, "x^2": 2, "x |x|": 2}.get(self.form, 0)
        below = [f"({regions[self.region].unit})" + ("^2" if power == 2 else "")] if power else []
        below += ["s"] if self.times == TIME_NAME else []
        return "/".join([unit, *below])

    def text(self, coefficients: Sequence[float], unit: str, regions: Mapping[str, Region]) -> str:
        """Return the term as text: "+ 180 N sin(2 pi position / 42 mm + 0.4)".

        Args:
            coefficients: one coefficient, SI; for a wave two, of its sine and its cosine.
            unit: SI unit of the disturbance.
            regions: regions by name, with those that the term `needs`.
        """
        size = coefficients[0]
        per = self.unit(unit, regions)
        turned = f" {regions[self.times].symbol or self.times}" if self.times else ""
        symbol = regions[self.region].symbol or self.region if self.region else ""
        if self.form == "wave":
            size = hypot(*coefficients)
            angle = atan2(coefficients[1], coefficients[0])
            what = f" sin(2 pi {symbol} / {_shown(self.at[0], regions[self.region])} {angle:+.2f})"
        elif self.form == "bump":
            middle, width = (_shown(value, regions[self.region]) for value in self.at)
            what = f" exp(-(({symbol} - {middle}) / {width})^2)"
        elif self.form == "1":
            what = ""
        else:
            what = " " + self.form.replace("x", symbol)
        return f"{'-' if size < 0.0 else '+'} {abs(size):.3g} {per}{turned}{what}"


_FORMS: Final[Mapping[str, Callable[[Array], Array]]] = {
    "1": np.ones_like,
    "x": lambda x: x,
    "|x|": np.abs,
    "x^2": np.square,
    "x |x|": lambda x: x * np.abs(x),
}


def _shown(value: float, region: Region) -> str:
    unit, factor = region.shown
    return f"{value * factor:.4g} {unit}"


def dictionary(along: Mapping[str, Array], regions: Mapping[str, Region]) -> list[Term]:
    """Return the terms to be tried, given the quantity (n,) of each region along the motion.

    There are constants, powers of each quantity, and waves and bumps along a periodic one.
    "direction" and "time" are only factors on these, and only if `along` has them. A region whose
    quantity has equal 1 % and 99 % quantiles, so that it hardly changes, gives no terms.
    """
    times = ["", *(name for name in (DIRECTION, TIME_NAME) if name in along)]
    found = [Term("", "1", factor) for factor in times]
    for name, values in along.items():
        if name in (DIRECTION, TIME_NAME):
            continue
        low, high = np.quantile(values, (0.01, 0.99))
        if not high > low:
            continue
        # Of a quantity that is never negative, |x| equals x.
        forms = ("x", "x^2") if low >= 0.0 else ("x", "|x|", "x^2", "x |x|")
        found += [Term(name, form, factor) for form in forms for factor in times]
        if regions[name].periodic:
            found += _along_a_length(name, low, high, [t for t in times if t != TIME_NAME])
    return found


def _along_a_length(name: str, low: float, high: float, times: Sequence[str]) -> Iterator[Term]:
    span = high - low
    for inverse in np.linspace(2.0 / span, 1.0 / SHORTEST_WAVE, WAVES):
        yield Term(name, "wave", "", (float(1.0 / inverse),))
    step = span / (BUMPS - 1)
    for middle in np.linspace(low, high, BUMPS):
        for width in (0.5 * step, step, 2.0 * step):
            for factor in times:
                yield Term(name, "bump", factor, (float(middle), float(width)))
