"""Puts friction into words, and makes the page of `rig identify friction` and the report's panel.

The page has the friction curves of recordings and their changes; the panel has friction over
velocity, from the load that the thesis's figure 7.26 shows.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Any, Final

import numpy as np

from estimator.friction import (
    CHANGE_PROBABILITY,
    PARAMETERS,
    FrictionCurve,
    FrictionEstimate,
    friction_changes,
    model_curve,
)
from rig.plant import Model
from rig.report.calibrations import CalibrationRow
from rig.report.panel import Array, Panel, TestData, Trace
from rig.report.templating import numbers, rendered

INTERVAL: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""
MM: Final = 1e3
_POINTS: Final = 120
SLOWEST: Final = 1e-4
"""Speed from which a model's curve is drawn, m/s."""


@dataclass(frozen=True)
class FrictionRun:
    """The friction of one recording.

    Attributes:
        recording: the recording as the user named it.
        name: name of its test, or of its file if it names no test.
        started: when it was begun, UTC; None if that is not recorded.
        curve: the identified friction.
    """

    recording: str
    name: str
    started: str | None
    curve: FrictionCurve


def in_words(parameter: str) -> str:
    """Return a parameter's name with spaces in place of underscores."""
    return parameter.replace("_", " ")


def shown(estimate: FrictionEstimate) -> str:
    """Return an estimate as text, value ± half the width of its 95 % interval, without the unit.

    The text is "not shown" if the parameter was not identified.
    """
    if estimate.value is None or estimate.standard_error is None:
        return "not shown"
    half = INTERVAL * estimate.standard_error
    decimals = max(0, 1 - floor(log10(half))) if half > 0.0 else 0
    return f"{estimate.value:.{decimals}f} \u00b1 {half:.{decimals}f}"


def needs_in_words(curve: FrictionCurve) -> Iterator[str]:
    """Yield for each motion that was missing a text with the parameters that it would identify."""
    for need in dict.fromkeys(each.needs for each in curve.estimates.values() if each.needs):
        names = [in_words(name) for name, each in curve.estimates.items() if each.needs == need]
        yield f"{', '.join(names)}: not identifiable; needs {need}"


def changes_in_words(runs: Sequence[FrictionRun]) -> Iterator[str]:
    """Yield lines on how friction changed from the first recording to the last.

    Nothing is yielded for a single recording.
    """
    if len(runs) < 2:
        return
    changes = friction_changes(runs[0].curve, runs[-1].curve)
    if not changes:
        yield "change from first to last: not known, they show no parameter in common"
        return
    rate = f"{100.0 * CHANGE_PROBABILITY:g} %"
    yield f"change from first to last (false alarms: {rate} of unchanged pairs at most):"
    units = {name: each.unit for name, each in runs[0].curve.estimates.items()}
    for change in changes:
        result = "changed" if change.significant else "no change shown"
        difference = f"{change.difference:+.3g} {units[change.name]}"
        yield f"{in_words(change.name)}: {difference}, z = {change.score:+.1f}, {result}"


def friction_page(
    runs: Sequence[FrictionRun], model: Model, calibrations: Sequence[CalibrationRow] = ()
) -> str:
    """Return the HTML page of the friction of some recordings, compared with the model's.

    Args:
        runs: friction of each recording, oldest first, at least one.
        model: the model that the filter assumed.
        calibrations: rows of the table of calibrations; none if no transducer has one.
    """
    units = {name: each.unit for name, each in runs[0].curve.estimates.items()}
    return rendered(
        "friction.html.j2",
        "friction.js",
        runs=runs,
        model=model.name,
        parameters=[(name, in_words(name), units[name]) for name in PARAMETERS],
        shown=shown,
        changes=list(changes_in_words(runs)),
        calibrations=calibrations,
        needs=[(run, list(needs_in_words(run.curve))) for run in runs],
        figures={"curves": _curves(runs, model), "trends": _trends(runs, model)},
    )


def _curves(runs: Sequence[FrictionRun], model: Model) -> list[dict[str, Any]]:
    """Return the traces of the model's curve, then of each recording's bins and fitted curve.

    Each trace has the index of its recording under `run`; that of the model is None.
    """
    fastest = max((run.curve.fastest or 0.0 for run in runs), default=0.0) or 0.5
    over = both_ways(SLOWEST, fastest)
    drawn = [_trace("model", None, "lines", over * MM, model_curve(over, model.parameters))]
    for index, run in enumerate(runs):
        curve = run.curve
        dots = _trace(run.name, index, "markers", *_medians(curve))
        spread = numbers(each.spread for each in curve.bins)
        drawn.append(dots | {"error_y": {"type": "data", "array": spread, "thickness": 1}})
        if curve.drawable and curve.slowest is not None and curve.fastest is not None:
            over = both_ways(curve.slowest, curve.fastest)
            drawn.append(_trace(run.name, index, "lines", over * MM, curve.force(over)))
    return drawn


def _trace(name: str, run: int | None, mode: str, across: Array, up: Array) -> dict[str, Any]:
    drawn = {"x": numbers(across), "y": numbers(up)}
    return {"name": name, "mode": mode, **drawn, "meta": {"run": run}}


def _trends(runs: Sequence[FrictionRun], model: Model) -> list[dict[str, Any]]:
    """Return the values of each parameter over the recordings, with intervals, and the model's."""
    trends = []
    for name in PARAMETERS:
        found = [run.curve.estimates[name] for run in runs]
        errors = [each.standard_error for each in found]
        halves = [None if error is None else INTERVAL * error for error in errors]
        values, unit = [each.value for each in found], found[0].unit
        trend = {"title": in_words(name), "unit": unit, "values": values, "halves": halves}
        trends.append(trend | {"model": getattr(model.parameters, name)})
    return trends


def friction(data: TestData) -> Panel | None:
    """Return the panel of a test's friction; None if the ram never slid steadily.

    It is None, too, if the test has no friction, because its filter does not estimate the load.
    """
    curve = data.outcome.friction
    if curve is None or curve.slowest is None or curve.fastest is None:
        return None
    traces = []
    if data.parameters is not None:
        over = both_ways(SLOWEST, curve.fastest)
        force = model_curve(over, data.parameters)
        traces.append(Trace("model", "reference", "line", over * MM, force, 3.0))
    if curve.drawable:
        over = both_ways(curve.slowest, curve.fastest)
        traces.append(Trace("fitted", "found", "line", over * MM, curve.force(over), 2.2))
    traces.append(Trace("medians, by velocity", "ink", "dots", *_medians(curve)))
    title, across = "Friction against velocity", ("velocity", "mm/s")
    return Panel("friction", title, _caption(curve), "N", tuple(traces), across=across)


def _medians(curve: FrictionCurve) -> tuple[Array, Array]:
    """Return velocities, mm/s, and median forces, N, of a curve's bins, (n,) each."""
    velocity = np.array([each.velocity * MM for each in curve.bins])
    return velocity, np.array([each.force for each in curve.bins])


def both_ways(slowest: float, fastest: float) -> Array:
    """Return velocities from -`fastest` to `fastest` for a curve, m/s, ascending.

    The speeds go from `slowest` to `fastest` in both directions, evenly spaced in the logarithm. A
    NaN stands between the directions, so that the curve has a gap there.
    """
    speeds = np.geomspace(slowest, fastest, _POINTS)
    return np.concatenate([-speeds[::-1], [np.nan], speeds])


def _caption(curve: FrictionCurve) -> str:
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
