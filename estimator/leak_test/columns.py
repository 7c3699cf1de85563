"""What leaks and known disturbances do to the accounts of a leak test, with their tolerances.

Each column is the oil in m^3 that both chambers seem to lose over time by one unit of its quantity.
The tolerances are standard deviations of what is expected before the test.
"""

from collections.abc import Iterator
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import Parameters, SensorParameters, signed_roots

from .soaks import Account, Levels, Soak

Array = NDArray[np.float64]

LEAK_EXPONENT: Final = 0.75
"""Power of the pressure by which leaks are taken to grow: midway between a laminar leak (1) and a
turbulent one (0.5)."""
LEAK_LAW: Final = 0.15
"""Tolerance of a flow by that power, as a share of it. The flow follows from how much more leaks at
high pressure than at low: 0.59 of it at a power of 0.75, 0.45 at 0.5 and 0.70 at 1, which is wrong
by up to 0.24; evenly drawn powers give a standard deviation of 0.13."""

EXPANSION: Final = 7e-4
"""Thermal expansion of mineral oil, 1/K (Merritt 1967, ch. 2)."""
DRIFT: Final = 0.03
"""Tolerance of a chamber's change of temperature, K/s: oil 20 K above its surroundings that cools
with a time constant of 600 s. Each chamber has its own."""
DRIFT_CHANGE: Final = 3e-4
"""Tolerance of how that rate changes, K/s^2: that of a time constant of 100 s, a chamber whose oil
was exchanged just before."""
RELAXATION: Final = 0.012
"""Share of a pressure step that has gone after 100 s by the heat of compression, where that goes by
conduction into a thick layer (a square root of time, Carslaw and Jaeger 1959). Isothermal oil is
softer than adiabatic oil by T alpha^2 beta / (rho c_p), 6 to 9 % with 0.7 to 1 GPa, of which a
seventh to a half goes so."""
RELAXATION_ERROR: Final = 0.012
"""Its tolerance."""
STEADY_RELAXATION: Final = 2e-4
"""Share of a pressure step that goes in each second by the heat of compression, where that goes
from thin layers and lines: a third of 6 %, with a time constant of 50 to 100 s."""
STEADY_RELAXATION_ERROR: Final = 2e-4
"""Its tolerance."""
SEAL_CREEP: Final = 0.0015
"""Share of a pressure step by which hoses and seals go on yielding in each e-fold of time
(logarithmic creep): elastomers creep by 1 to 3 % a decade, and carry a third of the elasticity."""
SEAL_CREEP_ERROR: Final = 0.0015
"""Its tolerance."""
UNSEEN_WAY: Final = 1.0 / sqrt(6.0)
"""Standard deviation of a change of position that the encoder does not show, in counts: the
difference of two readings, each rounded evenly to a count."""
BULK_MODULUS: Final = 0.15
"""Tolerance of the bulk modulus, as everywhere (docs/detection.md)."""

BLOCKING_COLUMNS: Final = tuple(f"leak of the blocking valve of chamber {each}" for each in (1, 2))
"""Names of the columns of the blocking valves' own leaks, that of chamber 1 first."""

_RELAXED_AT_S: Final = 100.0


class BlockingLeak(NamedTuple):
    """The data sheet's greatest leak of a shut blocking valve."""

    flow: float
    """m^3/s; the true leak is anywhere from 0 to this."""
    pressure: float
    """Pressure difference in Pa at which the flow is stated."""


class Column(NamedTuple):
    """One unknown quantity: its name, what one unit of it does, its tolerance, what is expected."""

    name: str
    effect: tuple[Array, ...]
    """For each soak float64 (n, 2): lost oil of both chambers in m^3 by one unit."""
    tolerance: float
    expected: float = 0.0


def leak_columns(accounts: list[Account], levels: Levels) -> Iterator[Array]:
    """Yield for each of the three leaks the oil lost in all soaks, (rows, 2), by a flow of 1 m^3/s.

    The flows are those at `levels.pressure`, and across the piston at `levels.difference`.
    """
    for of_1, of_2, across in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        parts = []
        for account in accounts:
            out = (np.maximum(account.pressures, 0.0) / levels.pressure) ** LEAK_EXPONENT
            drop = account.pressures[:, 0] - account.pressures[:, 1]
            past = across * np.sign(drop) * np.abs(drop / levels.difference) ** LEAK_EXPONENT
            flow = np.column_stack([of_1 * out[:, 0] + past, of_2 * out[:, 1] - past])
            parts.append(_over_time(flow, account.time_s))
        yield np.concatenate(parts)


def disturbances(
    soaks: list[Soak],
    accounts: list[Account],
    par: Parameters,
    sensors: SensorParameters,
    blocking: BlockingLeak,
) -> Iterator[Column]:
    """Yield the columns of all known disturbances of a test."""
    pairs = list(zip(soaks, accounts, strict=True))
    middle = 0.5 * (accounts[0].time_s[0] + accounts[-1].time_s[-1])
    for chamber in (0, 1):
        name = f"chamber {chamber + 1}"
        yield Column(
            f"temperature drift of {name}",
            tuple(_drift(each, par, chamber, middle, 0) for each in accounts),
            DRIFT,
        )
        yield Column(
            f"change of the temperature drift of {name}",
            tuple(_drift(each, par, chamber, middle, 1) for each in accounts),
            DRIFT_CHANGE,
        )
        yield Column(
            f"heat of compression in {name}",
            tuple(_yielding(s, a, chamber, np.sqrt) for s, a in pairs),
            RELAXATION_ERROR / sqrt(_RELAXED_AT_S),
            RELAXATION / sqrt(_RELAXED_AT_S),
        )
        yield Column(
            f"steady loss of the heat of compression in {name}",
            tuple(_yielding(s, a, chamber, np.positive) for s, a in pairs),
            STEADY_RELAXATION_ERROR,
            STEADY_RELAXATION,
        )
        yield Column(
            f"creep of seals and hoses of {name}",
            tuple(_yielding(s, a, chamber, np.log) for s, a in pairs),
            SEAL_CREEP_ERROR,
            SEAL_CREEP,
        )
        yield Column(
            BLOCKING_COLUMNS[chamber],
            tuple(_blocking(s, a, chamber, blocking) for s, a in pairs),
            blocking.flow / sqrt(12.0),
            0.5 * blocking.flow,
        )
    for number, account in enumerate(accounts):
        share = (account.time_s - account.time_s[0]) / np.ptp(account.time_s)
        ramp = par.piston_area * sensors.position_resolution * share
        effect = [np.zeros_like(each.lost) for each in accounts]
        effect[number] = np.column_stack([ramp, -ramp])
        yield Column(f"motion below a count in soak {number + 1}", tuple(effect), UNSEEN_WAY)


def _over_time(flow: Array, time_s: Array) -> Array:
    """Return the integral over time of flows (n, 2), m^3, from the first block on."""
    total = np.zeros_like(flow)
    total[1:] = np.cumsum(0.5 * (flow[1:] + flow[:-1]) * np.diff(time_s)[:, None], axis=0)
    return total


def _drift(account: Account, par: Parameters, chamber: int, middle: float, power: int) -> Array:
    volumes = account.compliance[:, chamber] * par.bulk_modulus
    flow = np.zeros_like(account.lost)
    flow[:, chamber] = EXPANSION * volumes * (account.time_s - middle) ** power
    return _over_time(flow, account.time_s)


def _yielding(soak: Soak, account: Account, chamber: int, law: np.ufunc) -> Array:
    """Return the oil lost to what goes on yielding after a pressure step, by `law` of the time."""
    since = soak.since_s + account.time_s - soak.time_s[0]
    effect = np.zeros_like(account.lost)
    step = account.compliance[:, chamber] * soak.steps[chamber]
    effect[:, chamber] = step * (law(since) - law(since[0]))
    return effect


def _blocking(soak: Soak, account: Account, chamber: int, blocking: BlockingLeak) -> Array:
    """Return the oil lost through a shut blocking valve by 1 m^3/s at its stated pressure."""
    port = (soak.port_1, soak.port_2)[chamber]
    flow = np.zeros_like(account.lost)
    flow[:, chamber] = signed_roots((account.pressures[:, chamber] - port) / blocking.pressure)
    return _over_time(flow, account.time_s)
