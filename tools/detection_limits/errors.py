"""Compares the default detector's errors with the bound, on rigs that differ from the model.

All rigs run the same motion. Their parameters are drawn from the same tolerances within which the
bound takes these constants for unknown. On average over such rigs, no estimator can have smaller
errors than the bound.
"""

from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts.flow import reference_drop
from estimator.leaks.detection import SETTLED_AFTER_S, Decision
from estimator.leaks.replaying import replay
from rig.io.simulated import simulated_rig
from rig.loop.simulated_loop import Motion
from rig.plant import FAULT_COLUMNS, LEAKS, NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from tools.simulated.recordings import SETTLE_TICKS, TRUE_LEAKS, recorded

from .bound import Bound, exact_noise, flow_bound
from .courses import follow, setpoints
from .study import ONSET_S
from .weaknesses import NULL_BIAS, OF_PARAMETERS, OF_TRANSDUCERS, TOLERANCE

Array = NDArray[np.float64]

MOTION: Final = "sine, 0.1 m at 0.5 Hz"
LEAK: Final = 0.3
"""Size of the leak, L/min.

It is so large that every run names it. If some runs did not, the errors of the others would be too
small.
"""
WINDOWS_S: Final = (2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0)
DRAWN: Final = (
    NULL_BIAS, "discharge_coefficient", "bulk_modulus", "supply_pressure", *OF_TRANSDUCERS,
)  # fmt: skip
"""Weaknesses of the model that the simulated rig can have with either sign."""


@dataclass(frozen=True)
class Errors:
    """The errors of the detector's flow, by the time since the onset.

    Attributes:
        windows_s: float64 (n,), times since the onset, s.
        flow: float64 (runs, n), estimate less truth, L/min; NaN where the leak was not named.
    """

    windows_s: Array
    flow: Array

    def rms(self) -> tuple[Array, Array]:
        """Return the rms error (n,), L/min, over the runs, and its relative standard error (n,).

        Only runs whose leak was named at that time count; if there is none, NaN and inf result.
        """
        count = np.isfinite(self.flow).sum(axis=0)
        return np.sqrt(np.nanmean(self.flow**2, axis=0)), 1.0 / np.sqrt(2.0 * count)


def errors(runs: int, jobs: int) -> Errors:
    """Run `runs` rigs with a leak of `LEAK`, in each place in turn; return the detector's errors.

    The run's number is the seed that draws its rig and noise. `jobs` is the number of processes.
    """
    with ProcessPoolExecutor(jobs) as pool:
        rows = list(pool.map(partial(_errors_of, windows_s=WINDOWS_S), range(runs)))
    return Errors(np.array(WINDOWS_S), np.array(rows))


def bound_beside() -> Bound:
    """Return the bound for the motion and the unknown constants of `errors`."""
    ticks = round((ONSET_S + WINDOWS_S[-1]) / TICK) + 2
    course = follow(MOTION, NOMINAL, setpoints(ticks)[MOTION])
    return flow_bound(course, exact_noise(course), ONSET_S, WINDOWS_S, weaknesses=DRAWN)


def _drawn(rng: np.random.Generator) -> tuple[Parameters, dict[str, float]]:
    """Draw a rig; return its parameters, and its transducers' biases (Pa) by name of weakness."""
    shifts = {name: TOLERANCE[name] * rng.standard_normal() for name in DRAWN}
    changed = {
        name: getattr(NOMINAL, name) * (1.0 + shifts[name]) if relative
        else getattr(NOMINAL, name) + shifts[name]
        for name, relative in OF_PARAMETERS.items() if name in DRAWN
    }  # fmt: skip
    rig = NOMINAL._replace(spool_null_bias=shifts[NULL_BIAS], **changed)
    return rig, {name: shifts[name] for name in OF_TRANSDUCERS}


def _errors_of(seed: int, windows_s: tuple[float, ...]) -> Array:
    rng = np.random.default_rng([seed, 3])
    truth, biases = _drawn(rng)
    onset, ticks = round(ONSET_S / TICK), round((ONSET_S + windows_s[-1]) / TICK) + 1
    leak = LEAKS[seed % len(LEAKS)]
    faults = np.zeros((ticks, len(FAULT_COLUMNS)))
    faults[onset:, FAULT_COLUMNS.index(leak)] = (
        LEAK * LITRE_PER_MINUTE / np.sqrt(reference_drop(NOMINAL, leak))
    )
    setpoint = setpoints(ticks)[MOTION]
    recording = recorded(
        simulated_rig(Model(parameters=truth), seed),
        Motion(setpoint, False, faults, float(setpoint[0]), SETTLE_TICKS),
    )
    for name, bias in biases.items():
        recording.channels[f"{name.removesuffix('_bias')}_Pa"] += bias
    flow = np.abs(recording[TRUE_LEAKS[leak]])
    history = {round(t, 3): held for t, held in replay(recording, Model()).history}
    return np.array(list(_at(windows_s, history, leak, flow / LITRE_PER_MINUTE)))


def _at(
    windows_s: tuple[float, ...], history: Mapping[float, Decision], leak: str, flow: Array
) -> Iterator[float]:
    settled = round((ONSET_S + SETTLED_AFTER_S) / TICK)
    for window_s in windows_s:
        held = history[round(ONSET_S + window_s, 3)]
        found = held.leak_m3_per_s
        if held.verdict != leak or found is None:
            yield float("nan")
            continue
        until = round((ONSET_S + window_s) / TICK)
        true = flow[min(settled, until - 1) : until].mean()
        yield float(found / LITRE_PER_MINUTE - true)
