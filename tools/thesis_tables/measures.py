"""What the thesis reads off a test: moving averages, flows and leak coefficients."""

from math import nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters.residuals import THESIS_WINDOW, moving_average_absolute
from estimator.leaks.detection import SETTLED_AFTER_S
from estimator.leaks.pattern import STARTED_S
from faults.leakage import linear_coefficient, square_root_coefficient, to_litres_per_minute
from faults.schedule import Fault
from rig.plant.integrator import TICK
from rig.plant.parameters import Parameters

from .trials import Trial

Array = NDArray[np.float64]

WINDOW_S: Final = THESIS_WINDOW * TICK
LEAST_DROP: Final = 1e5
"""Pa. Below some three sigmas of the pressure transducers flow / sqrt(drop) says nothing."""

_FLOWS: Final = {
    "external_leakage_1": ("flow_1_m3_per_s", "true_leak_1_m3_per_s"),
    "external_leakage_2": ("flow_2_m3_per_s", "true_leak_2_m3_per_s"),
    "internal_leakage": ("flow_internal_m3_per_s", "true_leak_internal_m3_per_s"),
}


class Change(NamedTuple):
    """A figure before and after the leak; None where there is no such time."""

    before: float | None
    after: float | None


def rise(change: Change) -> float:
    """Return by how much a figure is higher after the leak; NaN without a before or an after."""
    before, after = change
    return nan if before is None or after is None else after - before


class Coefficient(NamedTuple):
    """A leak coefficient, SI: mean and standard deviation over the samples."""

    mean: float
    deviation: float


def change(series: Array, time_s: Array, leak: Fault | None, lead_s: float = 0.0) -> Change:
    """Return the means of a series (n,) before and after a leak; before alone if there is none.

    Left out are the filter's start, the time the leak takes to open, and `lead_s` after each.
    """
    started = time_s >= STARTED_S + lead_s
    if leak is None:
        return Change(float(series[started].mean()), None)
    after = time_s >= leak.at_s + leak.travel_s + lead_s
    return Change(float(series[started & (time_s < leak.at_s)].mean()), float(series[after].mean()))


def average_change(error: Array, time_s: Array, leak: Fault | None) -> Change:
    """Return the moving average of absolute errors (n,) (section 4.4), its mean before and after.

    Only averages whose whole window lies before, or after, the leak's opening are taken.
    """
    return change(moving_average_absolute(error), time_s, leak, WINDOW_S)


def share_outside(position: Array, trial: Trial) -> Change:
    """Return the share of time, in %, that an estimated position (n,) in m is off the stroke."""
    par = trial.model.parameters
    outside = (position < par.stroke_min) | (position > par.stroke_max)
    return change(np.where(outside, 100.0, 0.0), trial.recording.time_s, trial.leak)


def meter_flow(trial: Trial, kind: str) -> Change:
    """Return a leak's mean flow in L/min as its meter reads it."""
    flow = to_litres_per_minute(trial.recording[_FLOWS[kind][0]])
    return change(flow, trial.recording.time_s, trial.leak, SETTLED_AFTER_S)


def true_flow(trial: Trial) -> float | None:
    """Return the mean absolute leak flow in L/min from 2 s after the leak on; None if healthy."""
    if trial.leak is None:
        return None
    flow = np.abs(trial.recording[_FLOWS[trial.leak.kind][1]])
    settled = trial.recording.time_s >= trial.leak.at_s + SETTLED_AFTER_S
    return float(to_litres_per_minute(flow[settled]).mean())


def metered_coefficient(trial: Trial) -> Coefficient | None:
    """Return the leak coefficient by flow meter and pressures (eqs. 5.3 to 5.7); None if healthy.

    From 2 s after the leak on, without samples whose drop is below `LEAST_DROP`.
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
    """Return the measured drop (n,) in Pa across a leak; no sign, as the meters read none."""
    p1, p2 = trial.recording["pressure_1_Pa"], trial.recording["pressure_2_Pa"]
    if kind == "internal_leakage":
        return np.abs(p1 - p2)
    return (p1 if kind == "external_leakage_1" else p2) - par.return_pressure
