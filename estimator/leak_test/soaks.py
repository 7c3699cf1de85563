"""Soaks of a locked cylinder: at which pressures they are made, and the oil each chamber loses.

The ram stands, both blocking valves are shut, and pressures and position are recorded.
"""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import Parameters, aeration_softening, chamber_volumes

Array = NDArray[np.float64]

SOAK_S: Final = 6.0
"""Length of a soak in s: three of them, with the moves between, make the half minute of a test."""
BLOCK_S: Final = 0.25
"""Length in s of the blocks over which samples are averaged. A leak that matters changes a
pressure by 0.02 to 0.1 MPa in it, nearly in a straight line."""
LEAST_PRESSURE: Final = 1e6
"""Least chamber pressure in Pa at which a block counts. Below it a little air would soften the oil
by more than the tolerance of its bulk modulus: 1 % of air halves the stiffness at 2 MPa."""
LEAST_BLOCKS: Final = 6
"""Fewest blocks of a soak: offset, rate and curvature are fitted to each, and twice as many do."""

_MEAN_SHARE: Final = 0.725
_LOW_SHARE: Final = 0.22
_FRICTION_SHARE: Final = 0.5


class Levels(NamedTuple):
    """Pressures of a leak test, Pa."""

    pressure: float
    """Mean of both chambers in the two soaks at high pressure: that at which leaks are stated."""
    difference: float
    """Difference between the chambers there, at which the leak across the piston is stated."""
    low: float
    """Pressure of both chambers in the soak at low pressure."""

    @property
    def soaks(self) -> tuple[tuple[float, float], ...]:
        """The pressures (p1, p2) in Pa of each soak in their order.

        The low one is in the middle, so that a temperature drift that changes steadily affects it
        as it affects the mean of the other two.
        """
        high = self.pressure + 0.5 * self.difference
        less = self.pressure - 0.5 * self.difference
        return (high, less), (self.low, self.low), (less, high)


def levels_of(par: Parameters) -> Levels:
    """Return the pressures of a leak test on a rig of these parameters.

    The high pressure is 0.725 of the supply's (10 MPa of 13.8), which leaves the valve a drop to
    regulate with, the low one 0.22 (3 MPa), well above `LEAST_PRESSURE`. The difference pushes the
    ram with half its stiction, so that it stays where it is.
    """
    supply = par.supply_pressure
    difference = min(_FRICTION_SHARE * par.stiction / par.piston_area, 0.4 * supply)
    return Levels(_MEAN_SHARE * supply, difference, _LOW_SHARE * supply)


@dataclass(frozen=True)
class Soak:
    """Samples of one soak, float64 (n,) each, SI, evenly spaced, of a cylinder that is locked.

    Attributes:
        time_s: time of each sample; that of the whole test, so that soaks follow each other.
        pressure_1: pressure of chamber 1 in Pa, as measured.
        pressure_2: pressure of chamber 2 in Pa, as measured.
        position: position of the ram in m, as measured.
        port_1: pressure at the servovalve's port 1 in Pa, behind the blocking valve.
        port_2: pressure at port 2 in Pa.
        steps: by how much each chamber's pressure was changed before the soak, Pa.
        since_s: time from that change to the first sample, s.
    """

    time_s: Array
    pressure_1: Array
    pressure_2: Array
    position: Array
    port_1: float
    port_2: float
    steps: tuple[float, float]
    since_s: float


class Account(NamedTuple):
    """Blocks of a soak: means, and the oil that each chamber has lost since the first block.

    The arrays are float64 (n,), or (n, 2) with a column for each chamber.
    """

    time_s: Array
    pressures: Array
    lost: Array
    compressed: Array
    """The part of `lost` that is due to pressure, m^3; the rest is due to the ram's motion."""
    compliance: Array
    """V / beta_e of each chamber, m^3/Pa."""
    samples: int
    """Samples of a block."""


def account_of(soak: Soak, par: Parameters) -> Account:
    """Return the account of a soak by eq. 2.3: what is lost is compression released plus way made.

    Blocks from the first one on in which a chamber is below `LEAST_PRESSURE` are left out.
    """
    spacing = (soak.time_s[-1] - soak.time_s[0]) / (soak.time_s.size - 1)
    samples = max(1, round(BLOCK_S / spacing))
    count = soak.time_s.size // samples
    table = np.column_stack([soak.time_s, soak.pressure_1, soak.pressure_2, soak.position])
    means = table[: count * samples].reshape(count, samples, 4).mean(axis=1)
    low = np.flatnonzero(means[:, 1:3].min(axis=1) < LEAST_PRESSURE)
    means = means[: low[0] if low.size else count]
    time_s, pressures, position = means[:, 0], means[:, 1:3], means[:, 3]
    compliance = np.array(
        [
            [
                volume / (par.bulk_modulus * aeration_softening(float(p), par))
                for p, volume in zip(each, chamber_volumes(float(x), par), strict=True)
            ]
            for each, x in zip(pressures, position, strict=True)
        ]
    ).reshape(-1, 2)
    compressed = np.zeros_like(compliance)
    middles = 0.5 * (compliance[1:] + compliance[:-1])
    compressed[1:] = -np.cumsum(middles * np.diff(pressures, axis=0), axis=0)
    way = par.piston_area * (position - position[:1])
    lost = compressed + np.column_stack([-way, way])
    return Account(time_s, pressures, lost, compressed, compliance, samples)
