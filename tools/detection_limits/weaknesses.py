"""The first-order effect of each known weakness of the model on the rig, for the bound.

The weaknesses and their tolerances are the detector's (`estimator.accounts.nuisances.NUISANCES`).
The null bias is a state of the product model; the other weaknesses are constants besides its
states.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts.nuisances import EDGE_REACHES, NUISANCES
from rig.plant import Parameters
from rig.plant.dynamics import aeration_compliance, signed_roots, valve_conductance
from rig.plant.integrator import TICK

from .courses import Course

Array = NDArray[np.float64]

TOLERANCE: Final = {nuisance.name: nuisance.sigma for nuisance in NUISANCES}

NULL_BIAS: Final = "spool_null_bias"
SUPPLY: Final = "supply_pressure"
OF_PARAMETERS: Final = {
    "discharge_coefficient": True,
    "bulk_modulus": True,
    SUPPLY: False,
    "return_pressure": False,
}
"""Weaknesses that are parameters of the model. True means that the tolerance is a share of the
parameter's value; False means that it is in the parameter's unit."""
OF_TRANSDUCERS: Final = {"pressure_1_bias": 1, "pressure_2_bias": 2}
"""Weaknesses that are biases of a reading, with the index of the state that it reads."""


def shifted(parameters: Parameters, name: str, sigmas: float) -> Parameters:
    """Return the parameters with one of `OF_PARAMETERS` shifted by `sigmas` tolerances."""
    value = getattr(parameters, name)
    shift = sigmas * TOLERANCE[name] * (value if OF_PARAMETERS[name] else 1.0)
    return parameters._replace(**{name: value + shift})


def inflows(course: Course) -> dict[str, Array]:
    """Return, by name, the inflow into the chambers by each weakness that acts as an inflow.

    Each array is float64 (ticks - 1, 2), in m^3/s per unit (SI) of the weakness. Its columns are
    chambers 1 and 2, and each row is the average from one tick to the next.
    """
    par = course.parameters
    middle = 0.5 * (course.states[1:] + course.states[:-1])
    spool, p1, p2, x = middle[:, 0], middle[:, 2], middle[:, 3], middle[:, 4]
    rates = np.diff(course.states, axis=0) / TICK
    extending = spool >= 0.0
    drop_1 = np.where(extending, par.supply_pressure - p1, p1 - par.return_pressure)
    drop_2 = np.where(extending, p2 - par.return_pressure, par.supply_pressure - p2)
    # The flow per opening into chamber 1, and out of chamber 2 (eqs. 2.1 and 2.2), is g1 and g2.
    g1, g2 = valve_conductance(par) * np.array([signed_roots(drop_1), signed_roots(drop_2)])
    q1, q2 = g1 * spool, g2 * spool
    lost_1, lost_2 = 0.5 * q1**3 / drop_1, 0.5 * q2**3 / drop_2
    side = np.sign(spool)
    v1 = par.line_volume_1 + par.piston_area * (x - par.stroke_min)
    v2 = par.line_volume_2 + par.piston_area * (par.stroke_max - x)
    none = np.zeros_like(q1)
    away = np.abs(spool)
    ajar = 0.5 * valve_conductance(par) * (np.hypot(1.0, away / 1e-6) - away / 1e-6)
    through_1 = signed_roots(par.supply_pressure - p1) - signed_roots(p1 - par.return_pressure)
    through_2 = signed_roots(par.supply_pressure - p2) - signed_roots(p2 - par.return_pressure)
    closed = par.supply_pressure + par.return_pressure

    def near(reach: int) -> Array:
        return np.minimum(away / EDGE_REACHES[reach], 1.0)

    pairs = {
        "edge_1um": (-g1 * side * near(0), g2 * side * near(0)),
        "edge_2um": (-g1 * side * near(1), g2 * side * near(1)),
        "edge_4um": (-g1 * side * near(2), g2 * side * near(2)),
        "edge_radius": (ajar * through_1, ajar * through_2),
        "land_leakage": (closed - 2.0 * p1, closed - 2.0 * p2),
        "seal_leakage_1": (-signed_roots(p1 - par.return_pressure), none),
        "seal_leakage_2": (none, -signed_roots(p2 - par.return_pressure)),
        "seal_leakage_internal": (-signed_roots(p1 - p2), signed_roots(p1 - p2)),
        "edge_supply_1": (q1 * extending, none),
        "edge_return_1": (q1 * ~extending, none),
        "edge_return_2": (none, -q2 * extending),
        "edge_supply_2": (none, -q2 * ~extending),
        "return_back_pressure": (-lost_1 * ~extending, lost_2 * extending),
        "supply_droop": (-lost_1 * extending, lost_2 * ~extending),
        "spool_delay": (g1 * rates[:, 0], -g2 * rates[:, 0]),
        "entrained_air": (
            -v1 * aeration_of(p1, par) * rates[:, 2],
            -v2 * aeration_of(p2, par) * rates[:, 3],
        ),
    }
    return {name: np.stack(pair, axis=1) for name, pair in pairs.items()}


def aeration_of(pressures: Array, parameters: Parameters) -> Array:
    """Return `aeration_compliance` (n,) at each pressure (n,), 1/Pa."""
    return np.array([aeration_compliance(pressure, parameters) for pressure in pressures])


def known(course: Course) -> tuple[str, ...]:
    """Return the names of those of the detector's `NUISANCES` that the bound takes into account."""
    have = {NULL_BIAS, *OF_PARAMETERS, *OF_TRANSDUCERS, *inflows(course)}
    return tuple(name for name in TOLERANCE if name in have)
