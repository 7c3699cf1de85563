"""The default detector's errors beside the bound, on rigs as unlike the model as it allows.

Along one motion the rig's parameters are drawn from the very tolerances that the bound has as
unknown constants: on average over them no estimator may do better.
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
"""L/min, which is named in every run: errors of those found only would be too small."""
WINDOWS_S: Final = (2.0, 3.0, 5.0, 10.0, 20.0, 40.0, 60.0)
DRAWN: Final = (
    NULL_BIAS, "discharge_coefficient", "bulk_modulus", "supply_pressure", *OF_TRANSDUCERS,
)  # fmt: skip
"""Weaknesses that the simulated rig can have either way round."""


@dataclass(frozen=True)
class Errors:
    """Errors of the detector's flow, by window.

    Attributes:
        windows_s: float64 (n,).
        flow: float64 (runs, n), estimate less truth in L/min; NaN where the leak was not named.
    """

    windows_s: Array
    flow: Array

    def rms(self) -> tuple[Array, Array]:
        """Return the root of the mean square (n,), and its relative standard error (n,)."""
        count = np.isfinite(self.flow).sum(axis=0)
        return np.sqrt(np.nanmean(self.flow**2, axis=0)), 1.0 / np.sqrt(2.0 * count)


def errors(runs: int, jobs: int) -> Errors:
    """Run rigs with a leak, in each place in turn, and return the detector's errors."""
    with ProcessPoolExecutor(jobs) as pool:
        rows = list(pool.map(partial(_errors_of, windows_s=WINDOWS_S), range(runs)))
    return Errors(np.array(WINDOWS_S), np.array(rows))


def bound_beside() -> Bound:
    """Return the bound for the same motion and unknowns."""
    ticks = round((ONSET_S + WINDOWS_S[-1]) / TICK) + 2
    course = follow(MOTION, NOMINAL, setpoints(ticks)[MOTION])
    return flow_bound(course, exact_noise(course), ONSET_S, WINDOWS_S, weaknesses=DRAWN)


def _drawn(rng: np.random.Generator) -> tuple[Parameters, dict[str, float]]:
    """Return a rig, and the biases of its pressure transducers in Pa by weakness."""
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
