"""Computes the figures of a test that are followed from run to run, with their standard errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.friction import FrictionCurve
from estimator.leaks import Decision
from faults import to_litres_per_minute
from rig.plant import TICK

Array = NDArray[np.float64]

_BLOCK: Final = round(1.0 / TICK)
"""Ticks of a block of innovations; blocks of 1 s, many times the filter's memory, count as
independent of each other."""
_TIMED: Final = {
    "loop_wakeup_p50": ("wakeup", "p50_s"),
    "loop_wakeup_p99": ("wakeup", "p99_s"),
    "loop_command_p99": ("tick_to_command", "p99_s"),
}


@dataclass(frozen=True)
class Figure:
    """A figure of a test.

    Attributes:
        value: the value, in `unit`.
        standard_error: standard error of the value, in the same unit; None if it is not known.
        unit: the unit as it is printed; empty for a plain number.
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
    """Return the figures of a test by name; a figure that is not known or not finite is left out.

    The names are `leak` (L/min); `residual_pressure_1` and `_2` (mean absolute innovation, Pa);
    `friction_NAME` (SI) for each friction parameter that was identified, where a NAME that begins
    with `friction_` gets no second prefix; `bulk_modulus` (Pa) if the detector estimates it; and on
    hardware `loop_wakeup_p50`, `loop_wakeup_p99`, `loop_command_p99` (s) and `loop_missed` (the
    share of ticks that were missed).

    Args:
        decision: the detector's last decision; None if there is none.
        innovations: innovations of pressures 1 and 2, Pa, float64 (n, 2).
        friction: the identified friction; None if there is none.
        timing: the summary of `rig.loop.timing.Timing`; None on a simulated rig.
    """
    found: dict[str, Figure] = {}
    if decision is not None and decision.leak_m3_per_s is not None:
        error = litres_per_minute(decision.leak_std_m3_per_s)
        found["leak"] = Figure(to_litres_per_minute(decision.leak_m3_per_s), error, "L/min")
    if decision is not None and "bulk_modulus_Pa" in decision.details:
        error = decision.details.get("bulk_modulus_std_Pa")
        found["bulk_modulus"] = Figure(decision.details["bulk_modulus_Pa"], error, "Pa")
    for chamber in (1, 2):
        level = residual_level(innovations[:, chamber - 1])
        if level is not None:
            found[f"residual_pressure_{chamber}"] = level
    for name, estimate in friction.estimates.items() if friction is not None else ():
        if estimate.value is not None:
            called = name if name.startswith("friction_") else f"friction_{name}"
            found[called] = Figure(estimate.value, estimate.standard_error, estimate.unit)
    if timing is not None:
        for name, (stage, percentile) in _TIMED.items():
            value = timing["stages"][stage][percentile]
            if value is not None:
                found[name] = Figure(float(value), None, "s")
        if timing["ticks"]:
            found["loop_missed"] = _missed_share(timing)
    return {name: figure for name, figure in found.items() if np.isfinite(figure.value)}


def _missed_share(timing: Mapping[str, Any]) -> Figure:
    """Return the share of ticks that were missed, with its standard error.

    Ticks are missed in stalls of the machine, which come independently of each other at whatever
    rate, and each takes L ticks in a row. The number of missed ticks is then the sum of a compound
    Poisson process, whose variance is estimated by the sum of L^2 without bias (Ross, Introduction
    to Probability Models, section 5.4.2). A summary of an earlier version does not tell it.
    """
    squares = timing.get("missed_squares")
    error = None if squares is None else float(np.sqrt(squares)) / timing["ticks"]
    return Figure(timing["missed"] / timing["ticks"], error, "")


def decided_figure(figure: str, decision: Decision | None) -> float:
    """Return a figure of `faults.DECIDED_FIGURES`, SI; NaN if the detector does not tell it."""
    if decision is None:
        return nan
    value = decision.leak_m3_per_s
    if figure == "bulk_modulus":
        value = decision.details.get("bulk_modulus_Pa")
    return nan if value is None else float(value)


def residual_level(innovation: Array) -> Figure | None:
    """Return the mean absolute innovation, with its standard error from blocks of 1 s.

    The result is None if fewer than two blocks can be used. NaN (the first row, and rows of missed
    ticks) is left out, and so are blocks that are NaN for half of their rows or more, and rows
    after the last complete block.

    Args:
        innovation: innovation of a pressure at each row, Pa, float64 (n,).
    """
    count = len(innovation) // _BLOCK
    sizes = np.abs(innovation[: count * _BLOCK]).reshape(count, _BLOCK)
    known = np.isfinite(sizes)
    blocks = [row[of] for row, of in zip(sizes, known, strict=True) if of.sum() > _BLOCK // 2]
    if len(blocks) < 2:
        return None
    means = np.array([block.mean() for block in blocks])
    return Figure(float(means.mean()), float(means.std(ddof=1) / np.sqrt(len(means))), "Pa")


def litres_per_minute(flow: float | None) -> float | None:
    """Return a flow in L/min that is given in m^3/s; None if it is None."""
    return None if flow is None else to_litres_per_minute(flow)
