"""Computes what the thesis measures in a test: moving averages, flows and leak coefficients."""

from math import nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters.residuals import THESIS_WINDOW, moving_average_absolute
from estimator.leaks.detection import SETTLED_AFTER_S
from estimator.leaks.pattern import STARTED_S
from faults.leakage import to_litres_per_minute
from faults.schedule import Fault
from rig.plant.integrator import TICK
from rig.plant.parameters import Parameters

from .laws import linear_coefficient, square_root_coefficient
from .trials import Trial

Array = NDArray[np.float64]

WINDOW_S: Final = THESIS_WINDOW * TICK
LEAST_DROP: Final = 1e5
"""Samples with a smaller pressure drop than this, Pa, are not used for flow / sqrt(drop).

It is about three standard deviations of the pressure transducers.
"""

_FLOWS: Final = {
    "external_leakage_1": ("flow_1_m3_per_s", "true_leak_1_m3_per_s"),
    "external_leakage_2": ("flow_2_m3_per_s", "true_leak_2_m3_per_s"),
    "internal_leakage": ("flow_internal_m3_per_s", "true_leak_internal_m3_per_s"),
}


class Change(NamedTuple):
    """The value of a figure before and after the leak; None if it is not known for one of them."""

    before: float | None
    after: float | None


def rise(change: Change) -> float:
    """Return the figure after the leak less that before it; NaN if one of them is None."""
    before, after = change
    return nan if before is None or after is None else after - before


class Coefficient(NamedTuple):
    """A leak coefficient: its mean and standard deviation over the samples.

    Both are in m^3/(s Pa^0.5), or in m^3/(s Pa) for a linear leak.
    """

    mean: float
    deviation: float


def change(series: Array, time_s: Array, leak: Fault | None, lead_s: float = 0.0) -> Change:
    """Return the means of a series (n,) before and after a leak.

    Left out are the start of the filter, the time in which the leak opens, and `lead_s` after each
    of them. Without a leak, the mean over all the rest of the test counts as before, and after is
    None.
    """
    started = time_s >= STARTED_S + lead_s
    if leak is None:
        return Change(float(series[started].mean()), None)
    after = time_s >= leak.at_s + leak.travel_s + lead_s
    return Change(float(series[started & (time_s < leak.at_s)].mean()), float(series[after].mean()))


def average_change(error: Array, time_s: Array, leak: Fault | None) -> Change:
    """Return the mean, before and after a leak, of the moving average of absolute errors.

    The moving average is that of section 4.4; `error` and `time_s` are (n,). Only averages whose
    whole window lies before or after the leak's opening are used.
    """
    return change(moving_average_absolute(error), time_s, leak, WINDOW_S)


def share_outside(position: Array, trial: Trial) -> Change:
    """Return the share of samples (%) at which an estimated position (n,), m, leaves the stroke.

    The samples before and after the leak are those of `change`: the filter's start and the time in
    which the leak opens are left out, and a healthy test has no share after the leak (None).
    """
    par = trial.model.parameters
    outside = (position < par.stroke_min) | (position > par.stroke_max)
    return change(np.where(outside, 100.0, 0.0), trial.recording.time_s, trial.leak)


def meter_flow(trial: Trial, kind: str) -> Change:
    """Return the mean reading (L/min) of the flow meter for a kind of leak, before and after it.

    The means are those of `change`; each begins 2 s after the filter's start or the leak's opening.
    """
    flow = to_litres_per_minute(trial.recording[_FLOWS[kind][0]])
    return change(flow, trial.recording.time_s, trial.leak, SETTLED_AFTER_S)


def true_flow(trial: Trial) -> float | None:
    """Return the mean magnitude of the true leak flow (L/min), from 2 s after the leak's onset on.

    It is None for a healthy test.
    """
    if trial.leak is None:
        return None
    flow = np.abs(trial.recording[_FLOWS[trial.leak.kind][1]])
    settled = trial.recording.time_s >= trial.leak.at_s + SETTLED_AFTER_S
    return float(to_litres_per_minute(flow[settled]).mean())


def metered_coefficient(trial: Trial) -> Coefficient | None:
    """Return the leak coefficient from flow meter and pressures (eqs. 5.3 to 5.7).

    Samples from 2 s after the leak's onset on are used, if their pressure drop is above
    `LEAST_DROP`. A healthy test has None; the figures are NaN if no sample can be used.
    """
    leak = trial.leak
    if leak is None:
        return None
    drop = _drop(trial, leak.kind, trial.model.parameters)
    used = (trial.recording.time_s >= leak.at_s + SETTLED_AFTER_S) & (drop > LEAST_DROP)
    law = linear_coefficient if leak.linear else square_root_coefficient
    values = law(trial.recording[_FLOWS[leak.kind][0]][used], drop[used])
    return Coefficient(float(values.mean()), float(values.std()))


def _drop(trial: Trial, kind: str, par: Parameters) -> Array:
    """Return the measured pressure drop (n,), Pa, across a leak.

    Across the piston it has no sign, because the flow meter has none either.
    """
    p1, p2 = trial.recording["pressure_1_Pa"], trial.recording["pressure_2_Pa"]
    if kind == "internal_leakage":
        return np.abs(p1 - p2)
    return (p1 if kind == "external_leakage_1" else p2) - par.return_pressure
