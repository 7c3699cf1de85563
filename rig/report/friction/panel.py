"""Draws the panel of friction over velocity, from the load that the thesis's figure 7.26 shows."""

from typing import Final

import numpy as np

from estimator.friction import FrictionCurve, model_curve
from rig.report.panel import Panel, TestData
from rig.report.traces import Array, Trace

from .words import in_words, needs_in_words, shown

MM: Final = 1e3
_POINTS: Final = 120
_SLOWEST: Final = 1e-4


def friction(data: TestData) -> Panel | None:
    """Return the panel of a test's friction; None if the ram never slid steadily.

    It is None, too, if the test has no friction, because its filter does not estimate the load.
    """
    curve = data.outcome.friction
    if curve is None or curve.slowest is None or curve.fastest is None:
        return None
    traces = []
    if data.parameters is not None:
        over = both_ways(_SLOWEST, curve.fastest)
        traces.append(
            Trace("model", "reference", "line", over * MM, model_curve(over, data.parameters), 3.0)
        )
    if curve.drawable:
        over = both_ways(curve.slowest, curve.fastest)
        traces.append(Trace("fitted", "found", "line", over * MM, curve.force(over), 2.2))
    velocity = np.array([each.velocity * MM for each in curve.bins])
    force = np.array([each.force for each in curve.bins])
    traces.append(Trace("medians, by velocity", "ink", "dots", velocity, force))
    return Panel(
        "friction",
        "Friction against velocity",
        caption(curve),
        "N",
        tuple(traces),
        across=("velocity", "mm/s"),
    )


def both_ways(slowest: float, fastest: float) -> Array:
    """Return velocities of both directions for a curve, m/s, sorted, with a NaN between the two.

    The speeds go from `slowest` to `fastest`, evenly spaced in the logarithm.
    """
    speeds = np.geomspace(slowest, fastest, _POINTS)
    return np.concatenate([-speeds[::-1], [np.nan], speeds])


def caption(curve: FrictionCurve) -> str:
    """Return the caption of the panel, with the identified parameters in words."""
    words = "Estimated load less the known spring, where the ram slid steadily; positive extending."
    fitted = [
        f"{in_words(name)} {shown(each)} {each.unit}"
        for name, each in curve.estimates.items()
        if each.identified
    ]
    if fitted:
        words += f" Fitted, with 95 % intervals: {', '.join(fitted)}."
    for need in needs_in_words(curve):
        words += f" {need[0].upper()}{need[1:]}."
    return words
