"""Makes the page of `rig identify friction`: friction curves of recordings and their changes."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from estimator.friction import PARAMETERS, model_curve
from rig.plant import Model
from rig.report.templating import numbers, rendered

from .panel import MM, both_ways
from .words import FrictionRun, changes_in_words, in_words, needs_in_words, shown

_INTERVAL: Final = 1.96


def friction_page(runs: Sequence[FrictionRun], model: Model) -> str:
    """Return the HTML page of the friction of some recordings, compared with the model's.

    Args:
        runs: friction of each recording, oldest first, at least one.
        model: the model that the filter assumed.
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
        needs=[(run, list(needs_in_words(run.curve))) for run in runs],
        figures={"curves": _curves(runs, model), "trends": _trends(runs, model)},
    )


def _curves(runs: Sequence[FrictionRun], model: Model) -> list[dict[str, Any]]:
    """Return the traces of the model's curve, then of each recording's bins and fitted curve.

    Each trace has the index of its recording under `run`; that of the model is None.
    """
    fastest = max((run.curve.fastest or 0.0 for run in runs), default=0.0) or 0.5
    over = both_ways(1e-4, fastest)
    drawn = [_trace("model", None, "lines", over * MM, model_curve(over, model.parameters))]
    for index, run in enumerate(runs):
        curve = run.curve
        velocity = np.array([each.velocity * MM for each in curve.bins])
        force = np.array([each.force for each in curve.bins])
        dots = _trace(run.name, index, "markers", velocity, force)
        spread = numbers(each.spread for each in curve.bins)
        drawn.append(dots | {"error_y": {"type": "data", "array": spread, "thickness": 1}})
        if curve.drawable and curve.slowest is not None and curve.fastest is not None:
            over = both_ways(curve.slowest, curve.fastest)
            drawn.append(_trace(run.name, index, "lines", over * MM, curve.force(over)))
    return drawn


def _trace(
    name: str, run: int | None, mode: str, across: np.ndarray, up: np.ndarray
) -> dict[str, Any]:
    return {
        "name": name,
        "mode": mode,
        "x": numbers(across),
        "y": numbers(up),
        "meta": {"run": run},
    }


def _trends(runs: Sequence[FrictionRun], model: Model) -> list[dict[str, Any]]:
    """Return the values of each parameter over the recordings, with intervals, and the model's."""
    trends = []
    for name in PARAMETERS:
        estimates = [run.curve.estimates[name] for run in runs]
        halves = [each.standard_error for each in estimates]
        trends.append(
            {
                "title": in_words(name),
                "unit": estimates[0].unit,
                "values": [each.value for each in estimates],
                "halves": [None if half is None else _INTERVAL * half for half in halves],
                "model": getattr(model.parameters, name),
            }
        )
    return trends
