"""The bypasses that make the leaks: each is a ball valve and a needle valve in series (figure 2.5).

The ball valve opens and shuts the bypass; the needle valve sets the size of the leak. Each is a
square-root orifice, q = k sqrt(dp), with coefficient k in m^3/(s Pa^0.5).
"""

from dataclasses import dataclass
from math import inf, pi, sqrt
from typing import Final

import numpy as np

from control import Checks
from rig.plant import NOMINAL

from .leakage import Value, square_root_flow, to_litres_per_minute
from .needle import ROUNDING, BypassError, NeedleCharacteristic, require_share
from .verdict import LEAK_KINDS, Verdict

# Flows are quoted at this drop: half the supply pressure of section 2.1, near a chamber's pressure.
_QUOTED_DROP: Final = 6.9e6


def series_coefficient(first: Value, second: Value) -> Value:
    """Return the coefficient of two square-root orifices in series, in the unit of the arguments.

    They carry the same flow and their drops add up, dp = q^2 / k_1^2 + q^2 / k_2^2, so
    1/k^2 = 1/k_1^2 + 1/k_2^2 (Merritt 1967, ch. 3: orifices in series). It is 0 if either is shut.
    """
    smaller, larger = np.minimum(first, second), np.maximum(first, second)
    # Division by the larger one keeps the result at or below the smaller one in spite of rounding.
    ratio = np.divide(smaller, larger, out=np.zeros(np.shape(larger)), where=larger > 0.0)
    return (smaller / np.sqrt(1.0 + ratio**2))[()]


def coefficient_beside(series: Value, known: Value) -> Value:
    """Return the coefficient of the second orifice, from those of the first and of both in series.

    This is the inverse of `series_coefficient`. All coefficients are in one unit.

    Args:
        series: coefficient of both orifices in series, below `known`.
        known: coefficient of the first orifice.
    """
    share = series / known
    return series / np.sqrt((1.0 - share) * (1.0 + share))


def port_opening(travelled: Value) -> Value:
    """Return the open part (0 to 1) of a ball valve's port after a part of its travel (0 to 1).

    The ball turns at constant speed, and its bore slides across a seat of equal bore. Two circles
    of radius r whose centres have the distance 2 r u, u = 1 - travelled, overlap by
    (2/pi) (acos u - u sqrt(1 - u^2)) of their area. The play between ball and seat, a few degrees
    in which nothing opens, is left out. Parts below 0 count as 0, and parts above 1 as 1.
    """
    u = 1.0 - np.clip(travelled, 0.0, 1.0)
    return ((2.0 / pi) * (np.arccos(u) - u * np.sqrt(1.0 - u**2)))[()]


def bore_coefficient(bore_m: float) -> float:
    """Return the coefficient of a round bore in m^3/(s Pa^0.5): C_d (pi/4) bore^2 sqrt(2/rho).

    The law is that of eq. 2.1. Discharge coefficient and density are those of table 2.1, which is
    exact enough, as an open ball valve restricts the flow far less than the needle.
    """
    area = 0.25 * pi * bore_m**2
    return NOMINAL.discharge_coefficient * area * sqrt(2.0 / NOMINAL.density)


@dataclass(frozen=True)
class BypassValve:
    """A bypass of the rig: a ball valve that opens and shuts it, a needle valve that sets the leak.

    Attributes:
        name: name of the bypass on its rig; error messages begin with it.
        ball_travel_s: time in s that the ball takes from shut to open.
        needle: characteristic of the needle valve.
        ball_bore_m: bore of the open ball valve in m.

    Raises:
        BypassError: the travel time is below 0 s or not finite, or the bore is not between 0.5 mm
            and 0.1 m.
    """

    name: str
    ball_travel_s: float
    needle: NeedleCharacteristic
    ball_bore_m: float = 6e-3

    def __post_init__(self) -> None:
        with Checks(self.name, BypassError, self) as checks:
            is_time = 0.0 <= self.ball_travel_s < inf
            remedy = "give the time from shut to open in seconds"
            checks.require(is_time, "ball_travel_s", "is below 0 s or not finite", remedy)
            is_bore = 5e-4 <= self.ball_bore_m <= 0.1
            limit = "is not between 0.0005 m and 0.1 m"
            checks.require(is_bore, "ball_bore_m", limit, "give the bore in metres")

    @property
    def ball_coefficient(self) -> float:
        """Return the coefficient of the open ball valve alone, in m^3/(s Pa^0.5)."""
        return bore_coefficient(self.ball_bore_m)

    @property
    def maximum(self) -> float:
        """Return the coefficient of the bypass with both valves fully open, in m^3/(s Pa^0.5)."""
        return float(series_coefficient(self.needle.maximum, self.ball_coefficient))

    @property
    def minimum(self) -> float:
        """Return the coefficient with the ball open and the needle shut, in m^3/(s Pa^0.5)."""
        return float(series_coefficient(self.needle.minimum, self.ball_coefficient))

    def effective(self, needle_opening: float, ball_position: float = 1.0) -> float:
        """Return the coefficient of both valves in series, in m^3/(s Pa^0.5).

        Args:
            needle_opening: opening of the needle, 0 (shut) to 1 (open).
            ball_position: part of the ball's travel that it has made, 0 (shut) to 1 (open).

        Raises:
            BypassError: either is not between 0 and 1.
        """
        with Checks(self.name, BypassError) as checks:
            require_share(checks, "needle_opening", needle_opening)
            require_share(checks, "ball_position", ball_position)
        ball = self.ball_coefficient * port_opening(ball_position)
        return float(series_coefficient(self.needle.coefficient(needle_opening), ball))

    def needle_opening_for(self, coefficient: float) -> float:
        """Return the needle opening (0 to 1) that gives a coefficient with the ball open.

        The coefficient is that of the whole bypass, in m^3/(s Pa^0.5). This is the inverse of
        `effective`.

        Raises:
            BypassError: the coefficient is below `minimum` or above `maximum`, by more than
                rounding, or NaN.
        """
        with Checks(self.name, BypassError) as checks:
            shown, remedy = f"{coefficient:.4g} m^3/(s Pa^0.5)", "shut the ball valve instead"
            limit = f"is below {self.minimum:.4g}, what the shut needle passes"
            is_above = coefficient >= self.minimum * (1.0 - ROUNDING)
            checks.require(is_above, "coefficient", limit, remedy, shown)
            flow = to_litres_per_minute(square_root_flow(self.maximum, _QUOTED_DROP))
            quoted = f"{flow:.3g} L/min at {_QUOTED_DROP / 1e6:g} MPa"
            limit = f"is above {self.maximum:.4g}, the most it passes ({quoted})"
            remedy = "ask for a smaller leak or fit a larger needle"
            is_below = not coefficient > self.maximum * (1.0 + ROUNDING)
            checks.require(is_below, "coefficient", limit, remedy, shown)
        return self.needle.opening(float(coefficient_beside(coefficient, self.ball_coefficient)))


def _nominal_bypass(name: str, maximum: float, ball_bore_m: float) -> BypassValve:
    # A pneumatic quarter-turn drive takes about half a second; needles often have rangeability 50.
    needle = NeedleCharacteristic.equal_percentage(maximum, 50.0)
    return BypassValve(name, ball_travel_s=0.5, needle=needle, ball_bore_m=ball_bore_m)


# The thesis's largest coefficient is 1.6e-8 (table 5.3), which is 2.4 L/min at 6.9 MPa. The
# actuator's bypasses here pass 4.1 L/min at that drop. The supply's bypass passes 20.5 L/min at
# 13.8 MPa, enough to starve the valve, which takes 26.6 L/min there when fully open.
NOMINAL_BYPASSES: Final[dict[str, BypassValve]] = {
    **{kind: _nominal_bypass(kind, 2.6e-8, 6e-3) for kind in LEAK_KINDS},
    Verdict.SUPPLY_LEAKAGE: _nominal_bypass(Verdict.SUPPLY_LEAKAGE, 9.2e-8, 1e-2),
}
"""Bypasses of the nominal rig, by the fault that each makes. Their values are chosen and not
measured, as there is no data sheet."""
