"""Computes gain margin, phase margin and largest pole of the leaking loop about steady motions.

The loop is linearised as a sampled system: the plant's transition over a tick is exact, the command
is held for a tick, and the controller's memory is updated once a tick. Friction is viscous only.
Stiction, and the fall of friction near standstill, damp or excite the loop under any controller;
the simulated runs include them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import log10, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from control.tolerant import BLEND_S, PRESSURE_FILTER_S, TOLERANT_STATE, tolerant_command
from rig.plant import NO_FAULT, NOMINAL, Parameters
from rig.plant.dynamics import PlantState, leak_flows, rates, valve_conductance, valve_flows
from rig.plant.faults import FaultInput
from rig.plant.integrator import TICK
from rig.plant.parameters import KARNOPP
from tools.thesis_tables.markdown import table

from .runs import NO_LEAK, Coefficients, leak_coefficients

Array = NDArray[np.float64]

VISCOUS: Final = NOMINAL._replace(friction_law=KARNOPP, stiction=0.0, coulomb=0.0)
"""The nominal rig with viscous friction alone, without stiction and Coulomb friction."""

POSITIONS: Final = (0.01, 0.3, 0.6)
"""Positions of the ram, m, from near one end of the stroke to near the other."""
OPENINGS: Final = (0.02, 0.05, 0.1, 0.2, 0.35, 0.5, 1.0, 2.0, 6.0)
"""Magnitudes of the proportional command, V; each is used with both signs."""
LOADS: Final = (-0.5, -0.2, 0.0, 0.2, 0.5)
"""Load pressures, as shares of the supply pressure."""

_PLANT: Final = 6
"""Number of linearised states: spool, its velocity, both pressures, position, velocity."""
_FREQUENCIES: Final = np.geomspace(0.1, 0.99 * np.pi / TICK, 600)


@dataclass(frozen=True)
class OperatingPoint:
    """Steady motion of a leaking rig under the tolerant controller.

    Attributes:
        proportional: command of the proportional loop, V.
        sent: command that the tolerant controller sends instead, V.
        pressure_1, pressure_2: chamber pressures at which both flow balances hold, Pa.
        position: of the ram, m.
        velocity: of the ram, m/s.
    """

    proportional: float
    sent: float
    pressure_1: float
    pressure_2: float
    position: float
    velocity: float


@dataclass(frozen=True)
class Margins:
    """The stability margins of one operating point, or the worst of several.

    Attributes:
        gain: factor by which the position loop's gain may grow before the loop is unstable; 1 if it
            is unstable already, 100 if it is stable with 100 times the gain.
        phase_deg: least phase margin at any crossover, in degrees; 180 if there is no crossover.
        radius: largest magnitude of the loop's poles; stable below 1.
    """

    gain: float
    phase_deg: float
    radius: float


def _sent(command: float, assumed: Coefficients, p1: float, p2: float) -> float:
    state = np.zeros(TOLERANT_STATE)
    return tolerant_command(command, assumed, p1, p2, NOMINAL, COMMAND_LIMIT, BLEND_S, state)


def _imbalance(
    proportional: float, load: float, p2: float, assumed: Coefficients, leaks: Coefficients
) -> tuple[float, float]:
    """Return how far the chambers' flow balances disagree (m^3/s), and the ram's velocity (m/s).

    In steady motion, the oil that fills one chamber equals the oil that leaves the other.
    """
    p1 = p2 + load
    sent = _sent(proportional, assumed, p1, p2)
    opening = NOMINAL.valve_gain * sent
    q1, q2 = valve_flows(opening, p1, p2, NOMINAL.supply_pressure, 0.0, valve_conductance(NOMINAL))
    leak_1, leak_2, across = leak_flows(p1, p2, 0.0, NOMINAL, FaultInput(*leaks, *NO_FAULT[3:]))
    left, right = q1 - leak_1 - across, q2 + leak_2 - across
    return left - right, 0.5 * (left + right) / NOMINAL.piston_area


def operating_point(
    proportional: float, position: float, load: float, assumed: Coefficients, leaks: Coefficients
) -> OperatingPoint | None:
    """Return the steady motion of the rig under given conditions; None if there is none.

    There is none if a chamber pressure would be below 1e5 Pa, if the balances cannot be met, or if
    the command would be at its limit.

    Args:
        proportional: command of the proportional loop, V.
        position: of the ram, m.
        load: load pressure, Pa.
        assumed: coefficients of the leak that the controller compensates for.
        leaks: coefficients of the leak that the rig has.
    """
    low, high = max(0.0, -load), NOMINAL.supply_pressure - max(0.0, load)
    # With more pressure in both chambers, less oil comes in and more leaves.
    for _ in range(60):
        middle = 0.5 * (low + high)
        excess, _ = _imbalance(proportional, load, middle, assumed, leaks)
        low, high = (middle, high) if excess > 0.0 else (low, middle)
    p2 = 0.5 * (low + high)
    excess, velocity = _imbalance(proportional, load, p2, assumed, leaks)
    sent = _sent(proportional, assumed, p2 + load, p2)
    if abs(excess) > 1e-9 or min(p2, p2 + load) < 1e5 or abs(sent) >= COMMAND_LIMIT:
        return None
    return OperatingPoint(proportional, sent, p2 + load, p2, position, velocity)


def _plant_rates(state: Array, sent: float, par: Parameters, leaks: Coefficients) -> Array:
    s, w, p1, p2, x, v = state
    fault = FaultInput(*leaks, *NO_FAULT[3:])
    return np.array(rates(s, w, p1, p2, x, v, 1.0, par.supply_pressure, 0.0, sent, par, fault))[
        :_PLANT
    ]


def _linearised(point: OperatingPoint, leaks: Coefficients) -> tuple[Array, Array]:
    """Return the transition over a tick: state matrix (6, 6) and input vector (6,).

    The plant is linearised about the point by central differences; the command is held for a tick.
    """
    state = PlantState(
        NOMINAL.valve_gain * point.sent, 0.0, point.pressure_1, point.pressure_2,
        point.position, point.velocity, 1.0, NOMINAL.supply_pressure, 0.0,
    )[:_PLANT]  # fmt: skip
    steps = np.array([1e-9, 1e-6, 10.0, 10.0, 1e-7, 1e-6])
    rate = np.zeros((_PLANT + 1, _PLANT + 1))
    for j, step in enumerate(steps):
        ahead, behind = np.array(state), np.array(state)
        ahead[j] += step
        behind[j] -= step
        rate[:_PLANT, j] = (
            _plant_rates(ahead, point.sent, VISCOUS, leaks)
            - _plant_rates(behind, point.sent, VISCOUS, leaks)
        ) / (2.0 * step)  # fmt: skip
    rate[1, _PLANT] = NOMINAL.valve_natural_frequency**2 * NOMINAL.valve_gain
    transition = _exponential(rate * TICK)
    return transition[:_PLANT, :_PLANT], transition[:_PLANT, _PLANT]


def _exponential(matrix: Array) -> Array:
    """Return exp(matrix) by scaling, a Taylor series and squaring (Moler and Van Loan 2003)."""
    squarings = max(0, int(np.ceil(np.log2(max(np.abs(matrix).sum(axis=1).max(), 1e-300)))) + 4)
    scaled = matrix / 2.0**squarings
    result, term = np.eye(matrix.shape[0]), np.eye(matrix.shape[0])
    for k in range(1, 12):
        term = term @ scaled / k
        result = result + term
    for _ in range(squarings):
        result = result @ result
    return result


def _controller(point: OperatingPoint, assumed: Coefficients) -> tuple[float, float, float]:
    """Return the derivatives of the command by proportional command, low-passed p1 and p2.

    They are in V/V, V/Pa and V/Pa.
    """
    u, p1, p2 = point.proportional, point.pressure_1, point.pressure_2
    volt, pascal = 1e-4, 100.0
    return (
        (_sent(u + volt, assumed, p1, p2) - _sent(u - volt, assumed, p1, p2)) / (2.0 * volt),
        (_sent(u, assumed, p1 + pascal, p2) - _sent(u, assumed, p1 - pascal, p2)) / (2.0 * pascal),
        (_sent(u, assumed, p1, p2 + pascal) - _sent(u, assumed, p1, p2 - pascal)) / (2.0 * pascal),
    )


def _loop(
    point: OperatingPoint, assumed: Coefficients, leaks: Coefficients
) -> tuple[Array, Array, Array]:
    """Return a (8, 8), b (8,) and c (8,) of the loop x+ = a x + b e, closed by e = c x.

    The loop is opened where the position is fed back. Its states are the plant's and both
    low-passed pressures; the feedback of these pressures is closed within `a`.
    """
    plant, held = _linearised(point, leaks)
    gain, by_p1, by_p2 = _controller(point, assumed)
    kept = 1.0 - TICK / PRESSURE_FILTER_S
    a = np.zeros((_PLANT + 2, _PLANT + 2))
    a[:_PLANT, :_PLANT] = plant
    b = np.concatenate([held, np.zeros(2)])
    for i in range(2):
        a[_PLANT + i, _PLANT + i] = kept
        a[_PLANT + i, 2 + i] = 1.0 - kept
    fed_back = np.zeros(_PLANT + 2)
    fed_back[_PLANT], fed_back[_PLANT + 1] = by_p1, by_p2
    a += np.outer(b, fed_back)
    c = np.zeros(_PLANT + 2)
    c[4] = -POSITION_GAIN * gain
    return a, b, c


def _radius(a: Array, b: Array, c: Array, factor: float) -> float:
    return float(np.abs(np.linalg.eigvals(a + factor * np.outer(b, c))).max())


def margins(point: OperatingPoint, assumed: Coefficients, leaks: Coefficients) -> Margins:
    """Return the margins at one operating point; the gain margin is searched from 1 to 100.

    Crossovers are searched from 0.1 rad/s up to nearly half the sampling rate.

    Args:
        point: the operating point.
        assumed: coefficients of the leak that the controller compensates for.
        leaks: coefficients of the leak that the rig has.
    """
    a, b, c = _loop(point, assumed, leaks)
    stable, unstable = 1.0, 100.0
    for _ in range(20):
        middle = sqrt(stable * unstable)
        if _radius(a, b, c, middle) < 1.0 + 1e-9:
            stable = middle
        else:
            unstable = middle
    z = np.exp(1j * _FREQUENCIES * TICK)
    values, vectors = np.linalg.eig(a)
    weights = (c @ vectors) * np.linalg.solve(vectors, b.astype(complex))
    response = -(weights / (z[:, None] - values)).sum(axis=1)
    size = np.abs(response)
    crossing = np.flatnonzero((size[:-1] - 1.0) * (size[1:] - 1.0) < 0.0)
    phase = np.degrees(np.abs(np.angle(-response[crossing])))
    return Margins(stable, float(phase.min(initial=180.0)), _radius(a, b, c, 1.0))


def operating_points(assumed: Coefficients, leaks: Coefficients) -> Iterator[OperatingPoint]:
    """Yield the steady motions at all `POSITIONS`, `OPENINGS` (both signs) and `LOADS`, if any."""
    openings = (*OPENINGS, *(-opening for opening in OPENINGS))
    for position, opening, load in product(POSITIONS, openings, LOADS):
        at = operating_point(opening, position, load * NOMINAL.supply_pressure, assumed, leaks)
        if at is not None:
            yield at


def least_margins(assumed: Coefficients, leaks: Coefficients) -> tuple[Margins, int]:
    """Return the worst of each margin over all operating points, and the number of points.

    The arguments are those of `margins`.

    Raises:
        ValueError: there is no operating point.
    """
    found = [margins(at, assumed, leaks) for at in operating_points(assumed, leaks)]
    least = Margins(
        min(one.gain for one in found),
        min(one.phase_deg for one in found),
        max(one.radius for one in found),
    )
    return least, len(found)


ESTIMATES: Final = (1.0, 1.5)
"""Flows that the controller compensates for, divided by the leak's flow."""
FLOWS: Final = (0.5, 1.0, 2.0, 4.0)
"""Sizes of the leaks, L/min. Chamber 2 is left out, because it is the mirror image of chamber 1."""


def margins_table() -> str:
    """Return a table of the worst margins, by place and size of the leak and by its estimate.

    The first row is that of the healthy loop; each leak has a row without compensation too.
    """
    rows = [_margins_row("none", NO_LEAK, NO_LEAK)]
    for place, name in ((0, "chamber 1"), (2, "internal")):
        for flow in FLOWS:
            leaks = leak_coefficients(place, flow)
            rows.append(_margins_row(f"{flow:g}, {name}, not made up for", NO_LEAK, leaks))
            for part in ESTIMATES:
                assumed = leak_coefficients(place, part * flow)
                rows.append(_margins_row(f"{flow:g}, {name}, taken for {part:.0%}", assumed, leaks))
    head = ("leak, L/min", "steady motions", "gain margin, dB", "phase margin, deg", "largest pole")
    return table(head, rows)


def _margins_row(name: str, assumed: Coefficients, leaks: Coefficients) -> list[str]:
    least, count = least_margins(assumed, leaks)
    decibels = 20.0 * log10(least.gain)
    return [name, str(count), f"{decibels:.1f}", f"{least.phase_deg:.0f}", f"{least.radius:.5f}"]
