"""Draws the figures of docs/detection.md on the limits of detection."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rig.plant.parameters import LITRE_PER_MINUTE
from tools.studies.leak_trials import Trial

from .bound import Bound
from .errors import Errors
from .study import NAMES, POWER, SIZES, named_after, operating_curve, power_curve, smallest_named

Array = NDArray[np.float64]

PUBLISHED: Final = (
    (0.154, "--", "thesis on its rig, unloaded"),
    (0.069, ":", "best published, internal (ASME FPMC 2014)"),
)
"""Smallest leaks that others found on such an actuator: L/min, line style, source."""
WINDOWS_S: Final = (2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0)
ROC_WINDOW_S: Final = 10.0
ROC_SIZES: Final = ((0.02, 0.04), (0.04, 0.08), (0.08, 0.16))
"""Smallest and largest leak that are taken together for one curve, L/min."""
LATENCY_SIZES: Final = ((0.03, 0.06), (0.06, 0.1), (0.1, 0.5))
_COLOURS: Final = {"product": "tab:blue", "thesis-6": "tab:orange"}
_BINS: Final = np.geomspace(*SIZES, 11)
_EXACT: Final = "bound, model exactly right"
_BUDGETED: Final = "bound, model wrong within its budget"


def _save(figure: Figure, file: Path) -> None:
    """Write a figure as PNG; the same figure always gives the same file."""
    figure.savefig(file, dpi=110, metadata={"Software": None})


def limits(
    leaks: Sequence[Trial], exact: Mapping[str, Bound], budgeted: Mapping[str, Bound], file: Path
) -> None:
    """Draw the smallest leak named over time since onset, and the chance to be named over size.

    Beside the first are the range of either bound over all motions, and published leaks.
    """
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    for bounds, colour, name in ((exact, "0.75", _EXACT), (budgeted, "0.45", _BUDGETED)):
        smallest = np.concatenate(
            [bound.smallest(1.0, POWER) for bound in bounds.values()]
        ) / LITRE_PER_MINUTE  # fmt: skip
        windows = next(iter(bounds.values())).windows_s
        left.fill_between(
            windows, smallest.min(axis=0), smallest.max(axis=0), color=colour, label=name, lw=0
        )
    for judge, name in NAMES.items():
        found = np.array([smallest_named(leaks, judge, window) for window in WINDOWS_S])
        if np.isfinite(found[:, 0]).any():
            _draw_smallest(left, found, name, _COLOURS[judge])
        else:
            left.plot([], [], color=_COLOURS[judge], label=f"{name}: none to {SIZES[1]:g} L/min")
        for window, style in ((60.0, "-"), (10.0, "--")):
            _draw_power(right, leaks, judge, window, style)
    for flow, style, source in PUBLISHED:
        left.axhline(flow, color="tab:red", lw=1, ls=style, label=source)
    left.set(xscale="log", yscale="log", xlabel="time from onset (s)", ylim=(2e-5, 30.0),
             ylabel="smallest leak found (L/min)",
             title="1 false alarm a day, found in 95 of 100")  # fmt: skip
    left.set_xticks([1, 2, 5, 10, 20, 60], labels=["1", "2", "5", "10", "20", "60"], minor=False)
    left.minorticks_off()
    right.set(xscale="log", xlabel="leak (L/min)", ylabel="chance to be named right",
              ylim=(-0.03, 1.03), title="named within a time from onset")  # fmt: skip
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8)
    _save(figure, file)


def _draw_smallest(axes: Any, found: Array, name: str, colour: str) -> None:
    best, low, high = found.T
    known = np.isfinite(best)
    upper = np.where(np.isfinite(high), high, SIZES[1])
    errors = np.abs(np.stack([best - low, upper - best]))[:, known]
    axes.errorbar(np.array(WINDOWS_S)[known], best[known], errors, color=colour, marker="o", ms=4,
                  capsize=2, label=name)  # fmt: skip


def _draw_power(axes: Any, leaks: Sequence[Trial], judge: str, window: float, style: str) -> None:
    flows = np.array([trial.flow for trial in leaks])
    named = np.array([named_after(trial, judge) <= window for trial in leaks])
    colour = _COLOURS[judge]
    smooth = np.geomspace(_BINS[0], _BINS[-1], 200)
    axes.plot(smooth, power_curve(flows, named).at(smooth), style, color=colour,
              label=f"{NAMES[judge]}, within {window:g} s")  # fmt: skip
    if style != "-":
        return
    which = np.digitize(flows, _BINS)
    for number in np.unique(which):
        chosen = which == number
        share, spread = named[chosen].mean(), 1.0 / np.sqrt(chosen.sum())
        half = 1.96 * np.sqrt(share * (1.0 - share)) * spread
        middle = np.exp(np.log(flows[chosen]).mean())
        axes.errorbar(middle, share, half, color=colour, marker="o", ms=4, capsize=2)


def outcomes(healthy: Sequence[Trial], leaks: Sequence[Trial], file: Path) -> None:
    """Draw alarms over false alarms as the threshold varies, and the share named over time."""
    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    styles = (":", "--", "-")
    judges = {"product, often": "product", "thesis-6": "thesis-6"}
    for judge, known_as in judges.items():
        for (low, high), style, marker in zip(ROC_SIZES, styles, "vso", strict=True):
            chosen = [trial for trial in leaks if low <= trial.flow < high]
            false, true = operating_curve(healthy, chosen, judge, ROC_WINDOW_S)
            left.step(false, true, style, where="post",
                      color=_COLOURS[known_as],
                      label=f"{NAMES[known_as]}, {low:g} to {high:g} L/min")  # fmt: skip
            if false.size:
                left.plot(false[-1], true[-1], marker, color=_COLOURS[known_as], ms=6)
    chance = np.geomspace(1e-4, 1.0, 50)
    left.plot(chance, chance, color="0.7", lw=1, label="chance")
    left.set_xscale("symlog", linthresh=1.0 / len(healthy))
    left.set_xticks([0.0, 0.01, 0.1, 1.0], labels=["0", "0.01", "0.1", "1"])
    left.set(xlim=(-0.2 / len(healthy), 1.1), xlabel="healthy rigs alarmed (part of trials)",
             ylabel="leaks alarmed (part of trials)", ylim=(-0.03, 1.03),
             title=f"threshold swept, {ROC_WINDOW_S:g} s from onset")  # fmt: skip
    waits = np.arange(0.0, 60.5, 0.5)
    for judge in NAMES:
        for (low, high), style in zip(LATENCY_SIZES, styles, strict=True):
            delays = np.array([named_after(t, judge) for t in leaks if low <= t.flow < high])
            named = [(delays <= wait).mean() for wait in waits]
            right.step(waits, named, style, where="post", color=_COLOURS[judge],
                       label=f"{NAMES[judge]}, {low:g} to {high:g} L/min")  # fmt: skip
    right.set(xscale="symlog", xlim=(0.0, 60.0), ylim=(-0.03, 1.03), xlabel="time from onset (s)",
              ylabel="leaks named right (part of trials)",
              title="latency, at 1 false alarm a day")  # fmt: skip
    right.set_xticks([0, 1, 2, 5, 10, 20, 60], labels=["0", "1", "2", "5", "10", "20", "60"])
    right.minorticks_off()
    for axes, place in ((left, "upper center"), (right, "center right")):
        axes.grid(alpha=0.3)
        axes.legend(fontsize=7, loc=place)
    _save(figure, file)


def error_check(found: Errors, bound: Bound, file: Path) -> None:
    """Draw the detector's rms error and the bound, both over the time since onset.

    The bound is the rms of those for the three places of the leak.
    """
    figure = Figure(figsize=(5.5, 4.0), layout="constrained")
    axes = figure.subplots()
    rms, relative = found.rms()
    axes.errorbar(found.windows_s, rms, 1.96 * rms * relative, color=_COLOURS["product"],
                  marker="o", ms=4, capsize=2, label=NAMES["product"])  # fmt: skip
    least = np.sqrt((bound.flow**2).mean(axis=0)) / LITRE_PER_MINUTE
    axes.plot(bound.windows_s, least, color="0.6", label=_EXACT)
    axes.set(xscale="log", yscale="log", xlabel="time from onset (s)",
             ylabel="rms error of the leak's flow (L/min)")  # fmt: skip
    axes.set_xticks([2, 5, 10, 20, 60], labels=["2", "5", "10", "20", "60"])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    _save(figure, file)
