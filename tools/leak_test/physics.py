"""Soaks of the drawn rigs, in equations of their own: none of the fit's formulas is used.

The oil cools exponentially, other in each chamber; its air is compressed polytropically; leaks and
those of the blocking valves follow powers of their own; the heat of compression goes by two
exponentials, hoses yield as one more, and the ram creeps logarithmically.
"""

import numpy as np
from numpy.typing import NDArray

from estimator.leak_test import SOAK_S, Levels, Soak, port_pressures
from rig.plant import DATA_SHEET, NOMINAL

from .drawing import Rigs

Array = NDArray[np.float64]

STEP_S = 0.005
SETTLE_S = 1.0
BETWEEN_S = 4.0
"""Time in s between two soaks, in which pressures are changed and valves move."""
_ATMOSPHERE = 101325.0
_POLYTROPIC = 1.3
_EXPANSION = 6.7e-4
_MISSED = 0.4e6
"""Standard deviation in Pa of how far a pressure is from its target when the valves are shut."""


def soaks_of(rigs: Rigs, levels: Levels, generator: np.random.Generator) -> list[list[Soak]]:
    """Return for each rig its soaks, as its transducers show them."""
    count = rigs.position.size
    before = np.full((count, 2), 0.5 * NOMINAL.supply_pressure)
    begun = 3.0
    tests: list[list[Soak]] = [[] for _ in range(count)]
    for number, targets in enumerate(levels.soaks):
        first = np.asarray(targets) + generator.normal(0.0, _MISSED, (count, 2))
        ports = port_pressures(number, NOMINAL.supply_pressure, NOMINAL.return_pressure)
        pressures, positions = _soak(rigs, levels, first, first - before, ports, begun)
        skipped = round(SETTLE_S / STEP_S)
        time_s: Array = begun + STEP_S * np.arange(pressures.shape[0], dtype=np.float64)
        drift = time_s[:, None, None] * rigs.zero_drift
        noise = DATA_SHEET.pressure_noise * generator.standard_normal(pressures.shape)
        shown = pressures + drift + noise
        count_m = DATA_SHEET.position_resolution
        seen = count_m * np.floor((positions + rigs.phase) / count_m)
        steps = np.asarray(targets) - before
        for i in range(count):
            tests[i].append(
                Soak(
                    time_s[skipped:], shown[skipped:, i, 0], shown[skipped:, i, 1],
                    seen[skipped:, i], *ports, (float(steps[i, 0]), float(steps[i, 1])), SETTLE_S,
                )
            )  # fmt: skip
        before = pressures[-1]
        begun += SETTLE_S + SOAK_S + BETWEEN_S
    return tests


def _soak(
    rigs: Rigs, levels: Levels, first: Array, steps: Array, ports: tuple[float, float], begun: float
) -> tuple[Array, Array]:
    """Return true pressures (samples, n, 2) and positions (samples, n) of one soak and settling."""
    area = NOMINAL.piston_area
    ticks = round((SETTLE_S + SOAK_S) / STEP_S)
    pressures, positions = np.empty((ticks, *first.shape)), np.empty((ticks, first.shape[0]))
    p, reach = first.copy(), rigs.creep * (steps[:, 0] - steps[:, 1]) / levels.difference
    for tick in range(ticks):
        since = tick * STEP_S
        x = rigs.position + reach * np.log1p(since)
        v = reach / (1.0 + since)
        pressures[tick], positions[tick] = p, x
        volumes = np.column_stack(
            [
                NOMINAL.line_volume_1 + area * x,
                NOMINAL.line_volume_2 + area * (NOMINAL.stroke_max - x),
            ]
        )
        absolute = np.maximum(p, 0.0) + _ATMOSPHERE
        bubbles = rigs.air[:, None] * (_ATMOSPHERE / absolute) ** (1.0 / _POLYTROPIC)
        softness = 1.0 / rigs.bulk_modulus[:, None] + bubbles / (_POLYTROPIC * absolute)
        lost = _leaks(rigs, levels, p, ports)
        lost[:, 0] += area * v
        lost[:, 1] -= area * v
        cooling = rigs.warmth / rigs.cooling_s[:, None]
        cooling = cooling * np.exp(-(begun + since) / rigs.cooling_s)[:, None]
        rate = -(lost / volumes + _EXPANSION * cooling) / softness
        quick = 0.3 / rigs.quick_s * np.exp(-since / rigs.quick_s)
        slow = 0.7 / rigs.slow_s * np.exp(-since / rigs.slow_s)
        rate -= steps * (rigs.heat * (quick + slow))[:, None]
        rate -= (
            steps * rigs.yielding * (np.exp(-since / rigs.yielding_s) / rigs.yielding_s)[:, None]
        )
        p = p + STEP_S * rate
    return pressures, positions


def _leaks(rigs: Rigs, levels: Levels, p: Array, ports: tuple[float, float]) -> Array:
    """Return the flows (n, 2) out of both chambers, m^3/s."""
    out = rigs.leaks[:, :2] * (np.maximum(p, 0.0) / levels.pressure) ** rigs.exponents[:, :2]
    drop = p[:, 0] - p[:, 1]
    across = rigs.leaks[:, 2] * np.sign(drop)
    across *= (np.abs(drop) / levels.difference) ** rigs.exponents[:, 2]
    behind = p - np.asarray(ports)
    through = np.sign(behind) * rigs.blocking * (np.abs(behind) / 1e7) ** rigs.blocking_exponents
    total: Array = out + through + np.column_stack([across, -across])
    return total
