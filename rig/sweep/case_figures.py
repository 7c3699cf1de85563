"""What a case's verdicts amount to beside what was injected."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.configuration import HEALTHY

from .group import Group
from .setting import Figures
from .ticks import SEEN, SETTLED

Array = NDArray[np.float64]

SILENT: Final = (HEALTHY, "inconclusive")
"""Verdicts that are no alarm."""


def outcome_columns(group: Group, verdicts: NDArray[np.str_], ends_s: Array) -> Figures:
    """Return verdict, whether it is right, detection time and latency, (LANES,) each.

    Args:
        group: of the cases.
        verdicts: (looks, LANES), what the detector held at each look.
        ends_s: (looks,), time of each look.
    """
    final = verdicts[-1]
    faults, onset_s = group.cases.faults[group.at], group.cases.onset_s[group.at]
    silent = np.isin(verdicts, SILENT)
    first_held = ends_s[np.argmax(verdicts == final, axis=0)]
    detected_s = np.where(silent[-1], np.nan, first_held)
    # Of a leak, what was held before it began; of a healthy rig, whatever was held.
    before = np.where(np.isnan(onset_s), np.inf, onset_s)
    early = (~silent & (ends_s[:, None] <= before)).any(axis=0)
    right = final == faults
    # What was held before the onset was a false alarm; the leak was found when it was held after.
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
    """Return the mean leak flow in m^3/s from 2 s after the onset on; NaN of a healthy rig.

    Args:
        total: (LANES,) sum of the flow at every tenth tick since.
        group: of the cases.
    """
    onset = group.cases.onset_tick[group.at]
    last = float(group.setting.ticks - 1)
    count = np.floor(last / SEEN) - np.ceil((onset + SETTLED) / SEEN) + 1.0
    leaky = ~np.isnan(group.cases.onset_s[group.at])
    return np.where(leaky, total / np.maximum(count, 1.0), np.nan)
