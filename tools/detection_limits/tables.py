"""Writes the tables on the limits of detection, for docs/detection.md and the README."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from math import isfinite
from typing import Final

import numpy as np

from rig.plant.parameters import LITRE_PER_MINUTE
from tools.pages.marked_tables import markdown
from tools.studies.leak_trials import Trial

from .bound import Bound
from .errors import Errors
from .study import NAMES, POWER, SECONDS, SIZES, named_after, smallest_named

WITHIN_S: Final = (10.0, 60.0)
UNKNOWN: Final = "not stated"
PUBLISHED: Final = (
    ("thesis, unloaded, open loop", "0.154 external", UNKNOWN),
    ("thesis, spring load, closed loop", "0.25 to 0.35", UNKNOWN),
    ("cross-correlation, ASME FPMC 2014", "0.069 internal", UNKNOWN),
    ("Hilbert-Huang transform, Goharrizi and Sepehri, IEEE T-IE 2012",
     "0.124 internal offline, 0.23 online", UNKNOWN),
    ("wavelets, Goharrizi and Sepehri, IJFP", "0.20 to 0.25 internal, 0.3 external", UNKNOWN),
    ("unscented Kalman filter, Nurmi and Mattila", "0.7 external", UNKNOWN),
    ("structured input on an electro-hydrostatic actuator, Thakur, University of Manitoba",
     "0.0042 internal", "85 %"),
)  # fmt: skip
"""Smallest leaks that others found, all on real rigs: source, leak in L/min, and share detected.
None is known to state its false alarms in a form that can be compared."""
LOCKED: Final = [
    "**leak test** of a locked cylinder with blocking valves, simulated",
    "0.001 in every place",
    "299 to 300 of 300",
    "none of 300 tests",
]
"""What `python -m tools.leak_test --seed 20262 --count 300` found (docs/leak_test.md)."""


def bounds(exact: Mapping[str, Bound], budgeted: Mapping[str, Bound]) -> str:
    """Return a table of the smallest leak that any test could find, in 1e-3 L/min.

    It has two rows for each motion, for an exact model and one with its budget of errors, and a
    column for each time since onset. The place of the leak is the one that is hardest to find.
    Found means with probability `POWER`, at one false alarm a day.
    """
    windows = next(iter(exact.values())).windows_s
    head = ["motion", *(f"{window:g} s" for window in windows)]
    rows = []
    for name, bound in exact.items():
        least = 1e3 * bound.smallest(1.0, POWER).max(axis=0) / LITRE_PER_MINUTE
        rows.append([name, *(f"{value:.2g}" for value in least)])
    for name, bound in budgeted.items():
        least = 1e3 * bound.smallest(1.0, POWER).max(axis=0) / LITRE_PER_MINUTE
        rows.append([f"{name}, with budget", *(f"{value:.2g}" for value in least)])
    return markdown(head, rows)


def power(healthy: Sequence[Trial], leaks: Sequence[Trial]) -> str:
    """Return a table with a row for each detector: healthy rigs alarmed, and smallest leak found.

    The smallest leak is the flow (L/min), fitted to all trials, that is named within each of the
    times `WITHIN_S` with probability `POWER`, with its 95 % interval, by place (external or
    internal) and load.
    """
    hours = len(healthy) * SECONDS / 3600.0
    head = ["", "healthy rigs alarmed", *(f"{name}, {within:g} s" for name, _ in _groups(leaks)
                                          for within in WITHIN_S)]  # fmt: skip
    rows = []
    for judge, name in NAMES.items():
        alarms = sum(trial.judged[judge].alarm_s() is not None for trial in healthy)
        cells = [name, f"{alarms} of {len(healthy)} in {hours:.1f} h"]
        for _, group in _groups(leaks):
            cells += [_interval(smallest_named(group, judge, within)) for within in WITHIN_S]
        rows.append(cells)
    return markdown(head, rows)


def outcomes(leaks: Sequence[Trial]) -> str:
    """Return a table by size of leak: how many each detector named right, and how soon.

    The size is the true mean flow, which may exceed the largest planned size; the last row has no
    upper limit.
    """
    head = ["leak, L/min", "leaks", *(f"{name}: {what}" for name in NAMES.values() for what in (
        "right within 10 s", "right at the end", "latency, median / 95 %"))]  # fmt: skip
    edges = (0.0, 0.01, 0.02, 0.03, 0.04, 0.06, 0.1, 0.2, np.inf)
    rows = []
    for low, high in pairwise(edges):
        chosen = [trial for trial in leaks if low <= trial.flow < high]
        size = f"{low:g} to {high:g}" if isfinite(high) else f"{low:g} and more"
        cells = [size, str(len(chosen))]
        for judge in NAMES:
            delays = np.array([named_after(trial, judge) for trial in chosen])
            soon, named = int((delays <= 10.0).sum()), delays[np.isfinite(delays)]
            right = sum(trial.judged[judge].verdict == trial.plan.fault for trial in chosen)
            late = np.percentile(named, [50, 95]) if named.size else None
            cells += [str(soon), str(right),
                      "–" if late is None else f"{late[0]:.1f} / {late[1]:.1f} s"]  # fmt: skip
        rows.append(cells)
    return markdown(head, rows)


def error_check(found: Errors, bound: Bound) -> str:
    """Return a table of the detector's rms error and the bound, by time since onset.

    The bound is the rms of those for the three places of the leak.
    """
    rms, relative = found.rms()
    least = np.sqrt((bound.flow**2).mean(axis=0)) / LITRE_PER_MINUTE
    named = np.isfinite(found.flow).sum(axis=0)
    head = ["time from onset", *(f"{window:g} s" for window in found.windows_s)]
    rows = [
        ["named", *(f"{count} of {found.flow.shape[0]}" for count in named)],
        ["rms error (L/min)",
         *(f"{a:.4f} ± {1.96 * a * b:.4f}" for a, b in zip(rms, relative, strict=True))],
        ["bound (L/min)", *(f"{value:.5f}" for value in least)],
    ]  # fmt: skip
    return markdown(head, rows)


def smallest(
    leaks: Sequence[Trial], exact: Mapping[str, Bound], budgeted: Mapping[str, Bound]
) -> str:
    """Return the README's table of the smallest leaks found, by others and by this detector.

    Its last rows are the bounds, which hold for any detector.
    """
    rows = [[name, found, detected, UNKNOWN] for name, found, detected in PUBLISHED]
    rates = [f"{100.0 * POWER:.0f} %", "one a day"]
    for name, group in _groups(leaks):
        found = [smallest_named(group, "product", within) for within in WITHIN_S]
        texts = [f"{_interval(f)} within {w:g} s" for f, w in zip(found, WITHIN_S, strict=True)]
        rows.append([f"**this detector**, {name}", ", ".join(texts), *rates])
    rows.append(LOCKED)
    for title, which in (("bound, model wrong within its budget", budgeted),
                         ("bound, model exactly right", exact)):  # fmt: skip
        texts = [f"{_range(which, within)} within {within:g} s" for within in WITHIN_S]
        rows.append([title, ", ".join(texts), *rates])
    return markdown(["", "smallest leak found, L/min", "detected", "false alarms"], rows)


def _groups(leaks: Sequence[Trial]) -> list[tuple[str, list[Trial]]]:
    return [
        (f"{kind}, {load}",
         [t for t in leaks if t.loaded == loaded
          and (t.plan.fault == "internal_leakage") == (kind == "internal")])
        for kind in ("external", "internal")
        for load, loaded in (("unloaded", False), ("spring load", True))
    ]  # fmt: skip


def _interval(found: tuple[float, float, float]) -> str:
    best, low, high = found
    if not isfinite(best):
        return f"above {SIZES[1]:g}"
    return f"{best:.3f} ({low:.3f} to {f'{high:.3f}' if isfinite(high) else 'more'})"


def _range(which: Mapping[str, Bound], within: float) -> str:
    """Return the text "least to greatest" of a bound over all motions and places, L/min."""
    values = np.concatenate([
        bound.smallest(1.0, POWER)[:, np.isclose(bound.windows_s, within)].ravel()
        for bound in which.values()
    ]) / LITRE_PER_MINUTE  # fmt: skip
    return f"{values.min():.2g} to {values.max():.2g}"
