"""Figures of a test to follow from run to run, each with its standard error where it has one."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.friction import FrictionCurve
from estimator.leaks import Decision
from faults import to_litres_per_minute
from rig.plant import TICK

Array = NDArray[np.float64]

_BLOCK: Final = round(1.0 / TICK)
"""Ticks after which innovations count as independent: 1 s, many times the filter's memory."""
_TIMED: Final = {
    "loop_wakeup_p50": ("wakeup", "p50_s"),
    "loop_wakeup_p99": ("wakeup", "p99_s"),
    "loop_command_p99": ("tick_to_command", "p99_s"),
}


@dataclass(frozen=True)
class Figure:
    """A figure of a test.

    Attributes:
        value: in its unit.
        standard_error: None where it is not known.
        unit: as printed; empty for a plain number.
    """

    value: float
    standard_error: float | None
    unit: str


def figures_of(
    decision: Decision | None,
    innovations: Array,
    friction: FrictionCurve | None,
    timing: Mapping[str, Any] | None,
) -> dict[str, Figure]:
    """Return all that is known, by name; what is not known has no entry.

    `leak` (L/min), `residual_pressure_1` and `_2` (mean absolute innovation, Pa), `friction_NAME`
    (SI; said once in `friction_asymmetry`) for each parameter that was identified, `bulk_modulus`
    (Pa) where a detector estimates it, and on hardware `loop_wakeup_p50`, `loop_wakeup_p99`,
    `loop_command_p99` (s), `loop_missed` (share).

    Args:
        decision: the last one.
        innovations: of pressures 1 and 2, Pa, float64 (n, 2).
        friction: what the motion showed of it.
        timing: `rig.loop.timing.Timing.summary`.
    """
    found: dict[str, Figure] = {}
    if decision is not None:
        found |= _of_decision(decision)
    for chamber in (1, 2):
        level = residual_level(innovations[:, chamber - 1])
        if level is not None:
            found[f"residual_pressure_{chamber}"] = level
    for name, estimate in friction.estimates.items() if friction is not None else ():
        if estimate.value is not None:
            called = name if name.startswith("friction_") else f"friction_{name}"
            found[called] = Figure(estimate.value, estimate.standard_error, estimate.unit)
    if timing is not None:
        found |= _of_loop(timing)
    return {name: figure for name, figure in found.items() if np.isfinite(figure.value)}


def residual_level(innovation: Array) -> Figure | None:
    """Return the mean absolute innovation (n,) in Pa, its error by blocks of 1 s; None if short.

    Rows without one (NaN: the first, and those of ticks that were missed) are left out, and blocks
    of which more than half are.
    """
    count = len(innovation) // _BLOCK
    sizes = np.abs(innovation[: count * _BLOCK]).reshape(count, _BLOCK)
    known = np.isfinite(sizes)
    blocks = [row[of] for row, of in zip(sizes, known, strict=True) if of.sum() > _BLOCK // 2]
    if len(blocks) < 2:
        return None
    means = np.array([block.mean() for block in blocks])
    return Figure(float(means.mean()), float(means.std(ddof=1) / np.sqrt(len(means))), "Pa")


def _of_decision(decision: Decision) -> dict[str, Figure]:
    found = {}
    if decision.leak_m3_per_s is not None:
        error = decision.leak_std_m3_per_s
        found["leak"] = Figure(
            to_litres_per_minute(decision.leak_m3_per_s),
            None if error is None else to_litres_per_minute(error),
            "L/min",
        )
    if "bulk_modulus_Pa" in decision.details:
        error = decision.details.get("bulk_modulus_std_Pa")
        found["bulk_modulus"] = Figure(decision.details["bulk_modulus_Pa"], error, "Pa")
    return found


def _of_loop(timing: Mapping[str, Any]) -> dict[str, Figure]:
    found = {}
    for name, (stage, percentile) in _TIMED.items():
        value = timing["stages"][stage][percentile]
        if value is not None:
            found[name] = Figure(float(value), None, "s")
    if timing["ticks"]:
        found["loop_missed"] = Figure(timing["missed"] / timing["ticks"], None, "")
    return found
