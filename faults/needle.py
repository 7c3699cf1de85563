"""The needle valve of a bypass: from opening to leakage coefficient, and back."""

import datetime
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Final

import numpy as np

from control import Checks, RequestError

# Least steps between points of a table, as parts of full scale. A calibration cannot distinguish
# closer points, and with finer steps the inverse would be exact to less than nine digits.
_OPENING_STEP: Final = 0.01
_COEFFICIENT_STEP: Final = 1e-4

# Relative tolerance for values that were computed from a limit and exceed it by rounding.
ROUNDING: Final = 1e-9

_EQUAL_PERCENTAGE_POINTS: Final = 51
_RANGEABILITY_LIMIT: Final = 1000.0


class BypassError(RequestError):
    """The error of a bypass valve whose description is not valid or that cannot do as asked."""


@dataclass(frozen=True)
class NeedleCharacteristic:
    """The leakage coefficient of a needle valve at each opening: a table, linear between points.

    Openings and coefficients both increase, so that each coefficient belongs to one opening and the
    inverse is exact. A cubic curve would need iteration for its inverse and could bend where
    nothing was measured.

    Attributes:
        openings: openings of the points, from 0 (shut) to 1 (open), (n,).
        coefficients: coefficient at each opening, m^3/(s Pa^0.5), (n,).
        date: day of the calibration; None if there was none.
        id: name of the valve or of its calibration.

    Raises:
        BypassError: there are fewer than two points or unequally many values; the openings do not
            run from 0 to 1; a coefficient is below 0 or infinite; or from one point to the next the
            opening rises by less than 0.01, or the coefficient by less than 1e-4 of the largest.
    """

    openings: tuple[float, ...]
    coefficients: tuple[float, ...]
    date: datetime.date | None = None
    id: str = "needle"

    def __post_init__(self) -> None:
        object.__setattr__(self, "openings", tuple(float(o) for o in self.openings))
        object.__setattr__(self, "coefficients", tuple(float(k) for k in self.coefficients))
        with Checks(self.id, BypassError) as checks:
            count = len(self.openings)
            remedy = "give one for each of at least two openings"
            fits, value = count == len(self.coefficients) >= 2, f"{len(self.coefficients)} values"
            checks.require(fits, "coefficients", f"for {count} openings", remedy, value)
            checks.finish()
            self._require_range(checks)
            self._require_increase(checks)

    def _require_range(self, checks: Checks) -> None:
        first, last = self.openings[0], self.openings[-1]
        checks.require(first == 0.0, "openings", "is not 0", "begin with the shut valve", first)
        checks.require(last == 1.0, "openings", "is not 1", "end with the fully open valve", last)
        first, last = self.coefficients[0], self.coefficients[-1]
        fits, shown = 0.0 <= first < inf and last < inf, f"{first} to {last}"
        limit, remedy = "do not lie between 0 and infinity", "give them in m^3/(s Pa^0.5)"
        checks.require(fits, "coefficients", limit, remedy, shown)

    def _require_increase(self, checks: Checks) -> None:
        for name, values, step in (
            ("openings", self.openings, _OPENING_STEP),
            ("coefficients", self.coefficients, _COEFFICIENT_STEP * self.coefficients[-1]),
        ):
            for index, (before, after) in enumerate(pairwise(values), start=1):
                is_above = 0.0 < after - before >= step * (1.0 - ROUNDING)
                limit = f"is not {step:.3g} above the point before ({before})"
                remedy = "drop the point or measure it again"
                checks.require(is_above, f"{name}[{index}]", limit, remedy, after)

    @classmethod
    def equal_percentage(cls, maximum: float, rangeability: float) -> "NeedleCharacteristic":
        """Return a table of 51 points of k(o) = maximum (R^o - 1) / (R - 1), R the rangeability.

        This is the equal-percentage law of control valves (IEC 60534-2-4), maximum R^(o - 1),
        shifted so that the valve shuts fully at o = 0. The maximum is in m^3/(s Pa^0.5).

        Raises:
            BypassError: the maximum is not above 0 or is infinite, or the rangeability is not above
                1 or is above 1000.
        """
        with Checks("equal percentage needle", BypassError) as checks:
            remedy = "give it in m^3/(s Pa^0.5)"
            checks.require(0.0 < maximum < inf, "maximum", "is not above 0", remedy, maximum)
            is_ratio = 1.0 < rangeability <= _RANGEABILITY_LIMIT
            limit = f"is not between 1 and {_RANGEABILITY_LIMIT:g}"
            remedy = "give the ratio of the steepest to the flattest slope, 50 for common valves"
            checks.require(is_ratio, "rangeability", limit, remedy, rangeability)
        openings = np.linspace(0.0, 1.0, _EQUAL_PERCENTAGE_POINTS)
        growth = np.expm1(openings * np.log(rangeability)) / np.expm1(np.log(rangeability))
        return cls(tuple(openings), tuple(maximum * growth), id="equal percentage needle")

    @classmethod
    def from_table(
        cls,
        points: Iterable[tuple[float, float]],
        date: datetime.date | None = None,
        id: str = "needle",  # noqa: A002 (the field's name)
    ) -> "NeedleCharacteristic":
        """Return the characteristic through points (opening, coefficient in m^3/(s Pa^0.5)).

        The points may be in any order, as a calibration measures them up and down the travel.

        Raises:
            BypassError: the points are no valid table (see `NeedleCharacteristic`).
        """
        ordered = sorted(points)
        return cls(tuple(o for o, _ in ordered), tuple(k for _, k in ordered), date, id)

    @property
    def minimum(self) -> float:
        """Return the coefficient of the shut needle, in m^3/(s Pa^0.5)."""
        return self.coefficients[0]

    @property
    def maximum(self) -> float:
        """Return the coefficient of the fully open needle, in m^3/(s Pa^0.5)."""
        return self.coefficients[-1]

    def coefficient(self, opening: float) -> float:
        """Return the coefficient in m^3/(s Pa^0.5) at an opening (0 to 1).

        Raises:
            BypassError: the opening is not between 0 and 1.
        """
        with Checks(self.id, BypassError) as checks:
            require_share(checks, "opening", opening)
        return float(np.interp(opening, self.openings, self.coefficients))

    def opening(self, coefficient: float) -> float:
        """Return the opening (0 to 1) at which the needle has a coefficient in m^3/(s Pa^0.5).

        Raises:
            BypassError: the coefficient is beyond that of the shut or of the open needle by more
                than rounding, or NaN.
        """
        low, high = self.minimum * (1.0 - ROUNDING), self.maximum * (1.0 + ROUNDING)
        with Checks(self.id, BypassError) as checks:
            fits, shown = low <= coefficient <= high, f"{coefficient:.4g} m^3/(s Pa^0.5)"
            limit = f"is not between {self.minimum:.4g} (shut) and {self.maximum:.4g} (fully open)"
            remedy = "ask for a coefficient between, or fit another needle"
            checks.require(fits, "coefficient", limit, remedy, shown)
        return float(np.interp(coefficient, self.coefficients, self.openings))


def require_share(checks: Checks, name: str, value: float) -> None:
    """Note a problem in `checks` if the value called `name` is below 0, above 1 or NaN."""
    limit = "is not between 0 (shut) and 1 (open)"
    checks.require(0.0 <= value <= 1.0, name, limit, "give a share", value)
