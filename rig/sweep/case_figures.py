"""Compares the verdicts of a case with the fault that was injected."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.configuration import HEALTHY

from .group import Group
from .setting import Figures
from .ticks import SEEN, SETTLED

Array = NDArray[np.float64]

SILENT: Final = (HEALTHY, "inconclusive")
"""Verdicts that name no fault, so that they are no alarm."""


def outcome_columns(group: Group, verdicts: NDArray[np.str_], ends_s: Array) -> Figures:
    """Return columns with verdict, whether it is right, times, and false alarm, (LANES,) each.

    The keys are `verdict`, `right`, `detected_at_s`, `latency_s` and `false_alarm`; see
    `rig.sweep.table.FIGURES`. The times are NaN if the last verdict names no fault, and the latency
    also if that verdict is wrong. An alarm is false if a verdict names a fault before the onset, or
    at any time in a healthy case.

    Args:
        group: the group of the cases.
        verdicts: the verdict after each block, (blocks, LANES).
        ends_s: time of each of these verdicts, s, (blocks,).
    """
    final = verdicts[-1]
    faults, onset_s = group.cases.faults[group.at], group.cases.onset_s[group.at]
    silent = np.isin(verdicts, SILENT)
    first_held = ends_s[np.argmax(verdicts == final, axis=0)]
    detected_s = np.where(silent[-1], np.nan, first_held)
    # An alarm is false before a leak begins, and at any time on a healthy rig.
    before = np.where(np.isnan(onset_s), np.inf, onset_s)
    early = (~silent & (ends_s[:, None] <= before)).any(axis=0)
    right = final == faults
    # A verdict before the onset is a false alarm; the latency ends at the first right one after it.
    since = (verdicts == final) & (ends_s[:, None] > np.nan_to_num(onset_s, nan=-1.0))
    latency_s = ends_s[np.argmax(since, axis=0)] - onset_s
    return {
        "verdict": final,
        "right": right,
        "detected_at_s": detected_s,
        "latency_s": np.where(right & ~silent[-1], latency_s, np.nan),
        "false_alarm": early,
    }


def true_flow(total: Array, group: Group) -> Array:
    """Return the mean leak flow from 2 s after the onset to the end, m^3/s; NaN if healthy.

    Args:
        total: sum of the flow over every tenth tick of that time, m^3/s, (LANES,).
        group: the group of the cases.
    """
    onset = group.cases.onset_tick[group.at]
    last = float(group.setting.ticks - 1)
    count = np.floor(last / SEEN) - np.ceil((onset + SETTLED) / SEEN) + 1.0
    leaky = ~np.isnan(group.cases.onset_s[group.at])
    return np.where(leaky, total / np.maximum(count, 1.0), np.nan)
