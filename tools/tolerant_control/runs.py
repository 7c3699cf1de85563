"""Runs of the simulated loop with a leak, under proportional or tolerant control."""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts.flow import reference_drop
from estimator.filters.registry import start_memory
from estimator.leaks.replaying import detector_for
from rig.io.simulated import simulated_rig
from rig.loop.decided import DECIDED, Decided
from rig.loop.reaction import Reaction
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import FAULT_COLUMNS, LEAKS, NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.runner.campaign.judging import Judge
from rig.runner.outcomes.decision_rows import DecisionRows
from tools.simulated.recordings import SETTLE_TICKS

Array = NDArray[np.float64]
Coefficients = tuple[float, float, float]
NO_LEAK: Final[Coefficients] = (0.0, 0.0, 0.0)

SECONDS: Final = 40.0
ONSET_S: Final = 8.0
TOLD_AFTER_S: Final = 3.0
"""After its onset a leak is confirmed, where no detector is asked."""
MEASURED_FROM_S: Final = 20.0
"""Errors and commands are judged from here to the end."""


@dataclass(frozen=True)
class Run:
    """One run, float64 (ticks,) each from `MEASURED_FROM_S` on.

    Attributes:
        error: setpoint less true position, m.
        command: V.
        confirmed_s: time of the first sample that was compensated for; None without.
    """

    error: Array
    command: Array
    confirmed_s: float | None

    @property
    def rms_error(self) -> float:
        """Root mean square of the error, m."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst_error(self) -> float:
        """Greatest error of either sign, m."""
        return float(np.abs(self.error).max())

    @property
    def final_error(self) -> float:
        """Mean error of the last 5 s, m: what is left at a hold."""
        return float(abs(self.error[-round(5.0 / TICK) :].mean()))

    @property
    def effort(self) -> float:
        """Root mean square of the command, V."""
        return float(np.sqrt(np.mean(self.command**2)))


def leak_coefficients(place: int, flow: float) -> Coefficients:
    """Return the coefficients of a leak of `flow` (L/min at its reference drop) in `LEAKS`."""
    drop = reference_drop(NOMINAL, LEAKS[place])
    found = [0.0, 0.0, 0.0]
    found[place] = flow * LITRE_PER_MINUTE / sqrt(drop)
    return found[0], found[1], found[2]


def ticks() -> int:
    """Return the ticks of a run."""
    return round(SECONDS / TICK)


def run(
    setpoint: Array,
    *,
    rig: Parameters = NOMINAL,
    leaks: Coefficients = NO_LEAK,
    told: Coefficients | None = NO_LEAK,
    seed: int = 1,
) -> Run:
    """Run the loop with a leak from `ONSET_S` on.

    Args:
        setpoint: float64 (ticks,), m.
        rig: the true parameters; filter and controller assume the nominal ones.
        leaks: true coefficients (k_el1, k_el2, k_il), m^3/(s Pa^0.5).
        told: what the loop is told from `TOLD_AFTER_S` after the onset on; None: what the default
            detector finds. Without a leak told, this is proportional control.
        seed: of the transducers' noise.
    """
    table = np.zeros((setpoint.size, len(FAULT_COLUMNS)))
    table[round(ONSET_S / TICK) :, :3] = leaks
    model = Model()
    memory = start_memory("product", model)
    loop = SimulatedLoop(
        simulated_rig(Model(parameters=rig), seed),
        Motion(setpoint, False, table, float(setpoint[0]), SETTLE_TICKS),
        memory,
        model.parameters,
        on_fault=Reaction.TOLERATE,
    )
    loop.position()
    judge = Judge(detector_for("product", model, 1.0), memory, loop.channels)
    decide = _detected(judge) if told is None else _told(told)
    parts = []
    while loop.ticks_left:
        rows = loop.advance(judge.ticks_due)
        loop.decided(decide(rows))
        parts.append(rows)
    return _measured(np.concatenate(parts), loop.channels, setpoint)


def _detected(judge: Judge) -> Callable[[Array], Array]:
    """Return what decides by the detector."""
    decisions = DecisionRows()

    def decide(rows: Array) -> Array:
        judge.take(rows)
        return decisions.row(*judge.history[-1])

    return decide


def _told(coefficients: Coefficients) -> Callable[[Array], Array]:
    """Return what decides that there are leaks of these coefficients."""

    def decide(rows: Array) -> Array:
        time_s = rows[-1, 0]
        row = np.full(len(DECIDED), np.nan)
        row[Decided.AT_S] = time_s
        present = coefficients if time_s >= ONSET_S + TOLD_AFTER_S - TICK else NO_LEAK
        row[Decided.PRESENT : Decided.PRESENT + 3] = present
        return row

    return decide


def _measured(rows: Array, channels: tuple[str, ...], setpoint: Array) -> Run:
    column = {name: rows[:, i] for i, name in enumerate(channels)}
    from_here = slice(round(MEASURED_FROM_S / TICK), None)
    compensated = np.flatnonzero(column["compensation_V"])
    return Run(
        (setpoint - column["true_position_m"])[from_here],
        column["command_V"][from_here].copy(),
        float(column["time_s"][compensated[0]]) if compensated.size else None,
    )
