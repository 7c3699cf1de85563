"""The bypass valves that make the leaks: a ball valve and a needle valve in series (figure 2.5).

The ball valve opens and shuts the bypass, the needle valve sets how much it leaks. Each is a
square-root orifice, q = k sqrt(dp), with k in m^3/(s Pa^0.5).
"""

from dataclasses import dataclass
from math import isfinite, pi, sqrt
from typing import Final

import numpy as np

from control import Checks
from rig.plant import NOMINAL

from .leakage import Value, square_root_flow, to_litres_per_minute
from .needle import ROUNDING, BypassError, NeedleCharacteristic, require_share
from .verdict import LEAK_KINDS, Verdict

# Half the supply pressure of section 2.1, which a chamber's is near: flows are quoted at this drop.
_QUOTED_DROP: Final = 6.9e6


def series_coefficient(first: Value, second: Value) -> Value:
    """Return what two square-root orifices in series pass, in their unit.

    They carry the same flow and their drops add up, dp = q^2 / k_1^2 + q^2 / k_2^2, so
    1/k^2 = 1/k_1^2 + 1/k_2^2 (Merritt 1967, ch. 3: orifices in series).
    """
    smaller, larger = np.minimum(first, second), np.maximum(first, second)
    # Both shut pass nothing; dividing by the larger keeps the result at or below the smaller.
    ratio = np.divide(smaller, larger, out=np.zeros(np.shape(larger)), where=larger > 0.0)
    return (smaller / np.sqrt(1.0 + ratio**2))[()]


def coefficient_beside(series: Value, known: Value) -> Value:
    """Return what an orifice passes that gives `series` together with a `known` one.

    The inverse of `series_coefficient`; all in one unit, `series` below `known`.
    """
    share = series / known
    return series / np.sqrt((1.0 - share) * (1.0 + share))


def port_opening(travelled: Value) -> Value:
    """Return the free share of a ball valve's port (0 to 1) after a share of its travel (0 to 1).

    The ball turns at constant speed and its bore slides across a seat of equal bore: two circles
    of radius r, their centres 2 r (1 - travelled) apart, overlap by
    (2/pi) (acos u - u sqrt(1 - u^2)) of their area, u = 1 - travelled. The play between ball and
    seat, a few degrees in which nothing opens, is left out.
    """
    u = 1.0 - np.clip(travelled, 0.0, 1.0)
    return ((2.0 / pi) * (np.arccos(u) - u * np.sqrt(1.0 - u**2)))[()]


def bore_coefficient(bore_m: float) -> float:
    """Return C_d (pi/4) bore^2 sqrt(2/rho) in m^3/(s Pa^0.5), the law of eq. 2.1 for a round bore.

    Discharge coefficient and density are table 2.1's: beside the needle the ball hardly counts.
    """
    area = 0.25 * pi * bore_m**2
    return NOMINAL.discharge_coefficient * area * sqrt(2.0 / NOMINAL.density)


@dataclass(frozen=True)
class BypassValve:
    """A bypass of the rig: a ball valve that opens and shuts it, a needle valve that sets the leak.

    Attributes:
        name: what the rig calls it; errors begin with it.
        ball_travel_s: time in s the ball takes from shut to open.
        needle: characteristic of the needle valve.
        ball_bore_m: bore of the open ball valve in m.

    Raises:
        BypassError: travel time or bore is out of range.
    """

    name: str
    ball_travel_s: float
    needle: NeedleCharacteristic
    ball_bore_m: float = 6e-3

    def __post_init__(self) -> None:
        checks = Checks(self.name, BypassError)
        checks.require(
            self.ball_travel_s >= 0.0 and isfinite(self.ball_travel_s),
            "ball_travel_s",
            self.ball_travel_s,
            "is below 0 s or not finite",
            "give the time from shut to open in seconds",
        )
        checks.require(
            5e-4 <= self.ball_bore_m <= 0.1,
            "ball_bore_m",
            self.ball_bore_m,
            "is not between 0.0005 m and 0.1 m",
            "give the bore in metres",
        )
        checks.finish()

    @property
    def ball_coefficient(self) -> float:
        """What the open ball valve alone would pass, in m^3/(s Pa^0.5)."""
        return bore_coefficient(self.ball_bore_m)

    @property
    def maximum(self) -> float:
        """What the bypass passes with both valves fully open, in m^3/(s Pa^0.5)."""
        return float(series_coefficient(self.needle.maximum, self.ball_coefficient))

    @property
    def minimum(self) -> float:
        """What the bypass passes with the ball open and the needle shut, in m^3/(s Pa^0.5)."""
        return float(series_coefficient(self.needle.minimum, self.ball_coefficient))

    def effective(self, needle_opening: float, ball_position: float = 1.0) -> float:
        """Return the coefficient in m^3/(s Pa^0.5) of both valves in series.

        Args:
            needle_opening: 0 (shut) to 1.
            ball_position: share of the ball's travel, 0 (shut) to 1 (open).

        Raises:
            BypassError: either is not between 0 and 1.
        """
        checks = Checks(self.name, BypassError)
        require_share(checks, "needle_opening", needle_opening)
        require_share(checks, "ball_position", ball_position)
        checks.finish()
        ball = self.ball_coefficient * port_opening(ball_position)
        return float(series_coefficient(self.needle.coefficient(needle_opening), ball))

    def needle_opening_for(self, coefficient: float) -> float:
        """Return the needle opening (0 to 1) that gives a coefficient with the ball open.

        The coefficient is that of the whole bypass, in m^3/(s Pa^0.5); the inverse of `effective`.

        Raises:
            BypassError: the bypass cannot pass that little or that much.
        """
        checks = Checks(self.name, BypassError)
        shown = f"{coefficient:.4g} m^3/(s Pa^0.5)"
        checks.require(
            coefficient >= self.minimum * (1.0 - ROUNDING),
            "coefficient",
            shown,
            f"is below {self.minimum:.4g}, what the shut needle passes",
            "shut the ball valve instead",
        )
        checks.require(
            not coefficient > self.maximum * (1.0 + ROUNDING),
            "coefficient",
            shown,
            f"is above {self.maximum:.4g}, the most it passes ({self._quoted_maximum()})",
            "ask for a smaller leak or fit a larger needle",
        )
        checks.finish()
        return self.needle.opening(float(coefficient_beside(coefficient, self.ball_coefficient)))

    def _quoted_maximum(self) -> str:
        flow = to_litres_per_minute(square_root_flow(self.maximum, _QUOTED_DROP))
        return f"{flow:.3g} L/min at {_QUOTED_DROP / 1e6:g} MPa"


def _nominal_bypass(name: str, maximum: float, ball_bore_m: float) -> BypassValve:
    # A pneumatic quarter-turn drive takes about half a second; rangeability 50 is a common needle.
    needle = NeedleCharacteristic.equal_percentage(maximum, 50.0)
    return BypassValve(name, ball_travel_s=0.5, needle=needle, ball_bore_m=ball_bore_m)


# The thesis's largest coefficient is 1.6e-8 (table 5.3), 2.4 L/min at 6.9 MPa: the actuator's
# bypasses pass 4.1 L/min there. The supply's passes 20.5 L/min at 13.8 MPa, enough to starve the
# valve, which takes 26.6 L/min there when fully open.
NOMINAL_BYPASSES: Final[dict[str, BypassValve]] = {
    **{kind: _nominal_bypass(kind, 2.6e-8, 6e-3) for kind in LEAK_KINDS},
    Verdict.SUPPLY_LEAKAGE: _nominal_bypass(Verdict.SUPPLY_LEAKAGE, 9.2e-8, 1e-2),
}
"""Bypasses of the nominal rig by the fault they make; chosen, not measured, for want of a sheet."""
