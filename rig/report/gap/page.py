"""Makes the page of `rig gap`: where the model is wrong, what it lacks, and how sure that is."""

import shlex
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import yaml
from numpy.typing import NDArray

from estimator.gap import ChannelGap, Curve, Discovered, FreeRun, GapResult, Plant
from rig.report.calibrations import CalibrationRow
from rig.report.templating import numbers, rendered
from rig.runner.outcomes import versions

from . import words as gap_words
from .words import band, channel, unit_for

Array = NDArray[np.float64]

_NORMAL_95: Final = 1.96
_POINTS: Final = 1200
"""Approximate number of points of a free simulation's line."""
_MODELS: Final = (("model as given", "bad"), ("model as written", "found"))
"""Name and role of the traces of both models."""


def gap_page(
    result: GapResult,
    plant: Plant,
    model: str,
    command: tuple[str, ...] = (),
    calibrations: Sequence[CalibrationRow] = (),
) -> str:
    """Return the HTML page of a gap search.

    Args:
        result: result of the gap search.
        plant: the plant whose model was tested.
        model: name of the model that was tested.
        command: the command line that ran the search, for the page.
        calibrations: rows of the table of calibrations; none if no transducer has one.
    """
    return rendered(
        "gap.html.j2",
        "gap.js",
        result=result,
        plant=plant,
        model=model,
        command=shlex.join(command),
        rivals=[
            (effect, rival, possible)
            for effect in result.effects
            for rivals, possible in ((effect.indistinguishable, True), (effect.excluded, False))
            for rival in rivals
        ],
        unsettled=[effect for effect in result.effects if effect.indistinguishable],
        unseen=[(effect.name, effect.unseen) for effect in result.effects if effect.unseen],
        campaigns=[
            yaml.safe_dump(dict(each.campaign), sort_keys=False) for each in result.experiments
        ],
        versions=versions(),
        words=gap_words,
        calibrations=calibrations,
        curves=drawn_curves(result),
        figures=figures_of(result),
    )


def drawn_curves(result: GapResult) -> list[Curve]:
    """Return the disturbances to plot, at most four, with the largest gain first.

    In the order of `result.where`, they are the first disturbance of each of the first two
    equations, and the first two that are not the first of their equation.
    """
    first: list[Curve] = []
    for curve in result.where:
        if curve.equation not in {each.equation for each in first}:
            first.append(curve)
    others = [curve for curve in result.where if not any(curve is each for each in first)]
    return sorted([*first[:2], *others[:2]], key=lambda curve: -curve.gain)


def figures_of(result: GapResult) -> dict[str, Any]:
    """Return the data of all plots of the page, by the plot's key, JSON-able."""
    drawn: dict[str, Any] = {
        f"curve_{number}": _curve(curve, [] if result.as_given else result.rest)
        for number, curve in enumerate(drawn_curves(result))
    }
    corrections = [effect.correction for effect in result.effects]
    for key, found in (("found", result.discovered), ("corrected", corrections)):
        for number, each in enumerate(found):
            if each is not None and each.curve is not None:
                drawn[f"{key}_{number}"] = _disturbance(each, each.curve)
    if result.channels:
        drawn["gap"] = _bars(result.channels)
    if result.channels and result.channels[0].bands:
        drawn["bands"] = _band_bars(result.channels)
    for number, run in enumerate(result.free_runs):
        drawn[f"run_{number}"] = _run(run)
    return drawn


def _curve(curve: Curve, rest: Sequence[Curve]) -> dict[str, Any]:
    """Return the plot of a disturbance of the model as given, with its 95 % band.

    `rest` are the disturbances that the model as written leaves; that of the same equation and
    region, if there is one, is drawn too.
    """
    traces = [_band(curve, "bad"), _line(curve, "model as given", "bad")]
    same = [c for c in rest if (c.equation, c.region) == (curve.equation, curve.region)]
    for left in same[:1]:
        traces += [_band(left, "found"), _line(left, "model as written", "found")]
    across, up = f"{curve.region}, {curve.region_shown[0]}", f"{curve.equation}, {curve.shown[0]}"
    return {"traces": traces, "across": across, "up": up}


def _disturbance(each: Discovered, curve: Curve) -> dict[str, Any]:
    """Return the plot of a discovered disturbance, with its 95 % band if that is finite.

    If the disturbance is a table, its knots are marked.
    """
    role = "found" if each.in_model else "bad"
    line = _line(curve, "disturbance", role, marked=each.form == "table")
    band = [_band(curve, role)] if np.isfinite(curve.errors).all() else []
    turned = " while extending" if each.times == "direction" else ""
    return {
        "traces": [*band, line],
        "across": f"{curve.region}, {curve.region_shown[0]}".rstrip(", "),
        "up": f"{each.place}{turned}, {curve.shown[0]}".rstrip(", "),
    }


def _line(curve: Curve, name: str, role: str, *, marked: bool = True) -> dict[str, Any]:
    unit, factor = curve.shown
    mode = "lines+markers" if marked else "lines"
    at = curve.at * curve.region_shown[1]
    return _trace(name, role, unit, at, curve.values * factor) | {"mode": mode}


def _trace(name: str, role: str, unit: str, across: Array, up: Array) -> dict[str, Any]:
    drawn = {"mode": "lines", "x": numbers(across), "y": numbers(up)}
    return {"name": name, **drawn, "meta": {"role": role, "unit": unit}}


def _band(curve: Curve, role: str) -> dict[str, Any]:
    """Return the 95 % band of a curve as the trace of one closed line."""
    at = curve.at * curve.region_shown[1]
    middle, half = curve.values * curve.shown[1], _NORMAL_95 * curve.errors * curve.shown[1]
    return {
        "mode": "lines",
        "x": numbers(np.concatenate([at, at[::-1]])),
        "y": numbers(np.concatenate([middle + half, (middle - half)[::-1]])),
        "fill": "toself",
        "line": {"width": 0},
        "hoverinfo": "skip",
        "showlegend": False,
        "meta": {"role": role},
    }


def _bars(channels: Sequence[ChannelGap]) -> dict[str, Any]:
    """Return bars of each channel's prediction error above the floor, in noise variances.

    They stand for the model as given (before) and the model as written (after).
    """
    names = [channel(gap.channel) for gap in channels]
    heights = [
        [max(getattr(gap, of) - gap.floor, 0.0) for gap in channels] for of in ("before", "after")
    ]
    return _before_and_after(names, heights, "above the floor, noise variances")


def _band_bars(channels: Sequence[ChannelGap]) -> dict[str, Any]:
    """Return the bars, by frequency band, of the channels' mean one-step error above the floor.

    They stand for the model as given (before) and the model as written (after).
    """
    names = [band(each) for each in channels[0].bands]
    floor, *errors = (
        np.array([[getattr(each, of) for each in gap.bands] for gap in channels])
        for of in ("floor", "before", "after")
    )
    heights = [np.maximum(each - floor, 0.0).mean(axis=0) for each in errors]
    return _before_and_after(names, heights, "excess, predicted variances")


def _before_and_after(
    names: Sequence[str], heights: Sequence[Iterable[float]], up: str
) -> dict[str, Any]:
    """Return bars of the model as given beside those of the model as written.

    Args:
        names: labels of the bars.
        heights: heights of the bars for the model as given, and for the model as written.
        up: label of the vertical axis.
    """
    traces = [
        {"type": "bar", "name": name, "x": names, "y": numbers(values), "meta": {"role": role}}
        for (name, role), values in zip(_MODELS, heights, strict=True)
    ]
    return {"traces": traces, "across": "", "up": up}


def _run(run: FreeRun) -> dict[str, Any]:
    # The unit suits the channel's own course; elsewhere its errors are shown in smaller units.
    unit, factor = unit_for(float(np.nanmax(np.abs(run.measured), initial=0.0)), run.unit)
    if run.unit == "m":
        unit, factor = "mm", 1e3
    step = max(1, len(run.time_s) // _POINTS)
    lines = zip((("measured", "ink"), *_MODELS), (run.measured, run.before, run.after), strict=True)
    traces = [
        _trace(name, role, unit, run.time_s[::step], values[::step] * factor)
        for (name, role), values in lines
    ]
    return {"traces": traces, "across": "time, s", "up": f"{channel(run.channel)}, {unit}"}
