"""The nuisances: known weaknesses of the rig's model that oil accounts show, with tolerances."""

from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE

Array = NDArray[np.float64]


class Nuisance(NamedTuple):
    """A known weakness of the model with its tolerance: `sigma`, a prior standard deviation.

    `sigma` is in `unit` (empty for a ratio), and `source` says where it comes from.
    """

    name: str
    sigma: float
    unit: str
    source: str


_HALF_SUPPLY: Final = 6.9e6
"""Pressure drop in Pa at which a chamber's leak is quoted; internal leaks are quoted at 2.5 MPa
(`flow.reference_drop`)."""
_BEARING: Final = 0.03 * LITRE_PER_MINUTE / sqrt(_HALF_SUPPLY)
_SEAL: Final = 0.05 * LITRE_PER_MINUTE / sqrt(2.5e6)
_LEAK_UNIT: Final = "m^3/(s Pa^0.5)"

EDGE_REACHES: Final = (1e-6, 2e-6, 4e-6)
"""Spool travels from null, in m, over which a metering edge differs from the ideal one.

The three nuisances `edge_...` together describe overlaps and rounded edges of up to some 5 um; a
single straight line does not."""

NUISANCES: Final = (
    Nuisance("spool_null_bias", 1e-5, "m", "section 3.2.1: 9.8e-6 m on the thesis's rig"),
    Nuisance("edge_1um", 3e-6, "m", "edge tolerance of a servovalve spool"),
    Nuisance("edge_2um", 3e-6, "m", "edge tolerance of a servovalve spool"),
    Nuisance("edge_4um", 3e-6, "m", "edge tolerance of a servovalve spool"),
    Nuisance("edge_radius", 1e-6, "m", "clearance and edge radius of a servovalve spool"),
    Nuisance("land_leakage", 1e-13, "m^3/(s Pa)", "0.04 L/min past closed lands at half supply"),
    Nuisance("discharge_coefficient", 0.05, "", "tolerance of 5 % (docs/model.md)"),
    Nuisance("edge_supply_1", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_return_1", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_return_2", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("edge_supply_2", 0.02, "", "grinding tolerance of one metering edge"),
    Nuisance("supply_pressure", 6.9e5, "Pa", "tolerance of 5 % (docs/model.md)"),
    Nuisance("pressure_1_bias", 1e5, "Pa", "0.5 % of a 20.7 MPa transducer"),
    Nuisance("pressure_2_bias", 1e5, "Pa", "0.5 % of a 20.7 MPa transducer"),
    Nuisance("return_pressure", 1e5, "Pa", "head and filter of the return line at rest"),
    Nuisance("return_back_pressure", 2e12, "Pa/(m^3/s)^2", "0.3 MPa at rated flow"),
    Nuisance("supply_droop", 2e12, "Pa/(m^3/s)^2", "0.3 MPa at rated flow"),
    Nuisance("spool_delay", 2e-3, "s", "valve bandwidth or spool sensor lag"),
    Nuisance("bulk_modulus", 0.15, "", "tolerance of 15 % (docs/model.md)"),
    Nuisance("entrained_air", 0.005, "", "half a percent of air at atmospheric pressure"),
    Nuisance("seal_leakage_1", _BEARING, _LEAK_UNIT, "0.03 L/min past a rod seal or a bypass"),
    Nuisance("seal_leakage_2", _BEARING, _LEAK_UNIT, "0.03 L/min past a rod seal or a bypass"),
    Nuisance("seal_leakage_internal", _SEAL, _LEAK_UNIT, "0.05 L/min past the piston's seal"),
)
NUISANCE_COUNT: Final = len(NUISANCES)
DRIFT: Final = 0.03
"""Part of its tolerance by which a nuisance may drift in minutes, or from one recording to another.

This is 0.3 um of spool null (0.03 L/min), or 3 kPa of a transducer. A larger value would hide the
leaks that a baseline is to reveal."""


def nuisance_index(name: str) -> int:
    """Return the index of a nuisance in `NUISANCES`.

    Raises:
        ValueError: there is no nuisance of that name.
    """
    return [nuisance.name for nuisance in NUISANCES].index(name)


NULL_SHIFT: Final = 0.01
"""Standard deviation of a shift of the spool's null in the seconds in which a fault begins, as a
part of the null's tolerance: 0.1 um, or 0.01 L/min."""


@dataclass(frozen=True)
class NuisanceBelief:
    """Mean (n,) and covariance (n, n) of the nuisances, each in units of its tolerance."""

    mean: Array
    covariance: Array


UNINFORMED: Final = NuisanceBelief(np.zeros(NUISANCE_COUNT), np.eye(NUISANCE_COUNT))
"""The belief before any data: mean zero, and each nuisance within its tolerance."""
