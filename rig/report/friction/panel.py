"""The panel of friction against velocity, of the load that figure 7.26 draws over time."""

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
    """Return the panel of a test's friction; None where no steady sliding was seen."""
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
    """Return velocities in m/s of both directions, dense where slow, a gap between them."""
    speeds = np.geomspace(slowest, fastest, _POINTS)
    return np.concatenate([-speeds[::-1], [np.nan], speeds])


def caption(curve: FrictionCurve) -> str:
    """Return what the panel shows, with the parameters in words."""
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
