"""Runs the simulated loop with a leak, with and without tolerant control."""

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import PLAIN
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
from rig.runner.outcomes.reactions import DecisionRows
from tools.simulated.recordings import SETTLE_TICKS
from tools.simulated.tracking_guide import tracking_guide

Array = NDArray[np.float64]
Coefficients = tuple[float, float, float]
NO_LEAK: Final[Coefficients] = (0.0, 0.0, 0.0)

SECONDS: Final = 40.0
ONSET_S: Final = 8.0
TOLD_AFTER_S: Final = 3.0
"""If no detector runs, the controller is given the leak this long after its onset, s."""
MEASURED_FROM_S: Final = 20.0
"""Errors and commands are measured from this time of the run to its end, s."""


@dataclass(frozen=True)
class Run:
    """The measured part of one run, from `MEASURED_FROM_S` on.

    Attributes:
        error: setpoint less true position, float64 (ticks,), m.
        command: float64 (ticks,), V.
        confirmed_s: time in the whole run of the first sample at which the controller compensated
            for a leak, s; None if it never did.
    """

    error: Array
    command: Array
    confirmed_s: float | None

    @property
    def rms_error(self) -> float:
        """The root mean square of the error, m."""
        return float(np.sqrt(np.mean(self.error**2)))

    @property
    def worst_error(self) -> float:
        """The greatest magnitude of the error, m."""
        return float(np.abs(self.error).max())

    @property
    def final_error(self) -> float:
        """The magnitude of the mean error over the last 5 s, m: what a hold leaves at its end."""
        return float(abs(self.error[-round(5.0 / TICK) :].mean()))

    @property
    def effort(self) -> float:
        """The root mean square of the command, V."""
        return float(np.sqrt(np.mean(self.command**2)))


def leak_coefficients(place: int, flow: float) -> Coefficients:
    """Return the leak coefficients (k_el1, k_el2, k_il), m^3/(s Pa^0.5), of a rig with one leak.

    The coefficients of the other two places are 0.

    Args:
        place: index of the leak in `LEAKS`.
        flow: its flow at its reference pressure drop, L/min.
    """
    drop = reference_drop(NOMINAL, LEAKS[place])
    found = [0.0, 0.0, 0.0]
    found[place] = flow * LITRE_PER_MINUTE / sqrt(drop)
    return found[0], found[1], found[2]


def ticks() -> int:
    """Return the number of ticks (1 ms) of a run of `SECONDS`."""
    return round(SECONDS / TICK)


def run(
    setpoint: Array,
    *,
    rig: Parameters = NOMINAL,
    leaks: Coefficients = NO_LEAK,
    told: Coefficients | None = NO_LEAK,
    seed: int = 1,
    tracking: bool = False,
) -> Run:
    """Run the simulated loop with a leak that opens at `ONSET_S`.

    Args:
        setpoint: float64 (ticks,), m, longer than `MEASURED_FROM_S`.
        rig: the true parameters; filter and controller assume the nominal ones.
        leaks: true coefficients (k_el1, k_el2, k_il), m^3/(s Pa^0.5).
        told: coefficients that the controller compensates for, from `TOLD_AFTER_S` after the onset
            on; with `NO_LEAK` nothing is made up for. None means that the default detector
            decides.
        seed: draws the transducers' noise.
        tracking: whether the position loop has the tracking law, instead of its gain alone.
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
        guide=tracking_guide(setpoint) if tracking else PLAIN,
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
    """Return a function that lets the detector judge rows and returns its decision as a row."""
    decisions = DecisionRows()

    def decide(rows: Array) -> Array:
        judge.take(rows)
        return decisions.row(*judge.history[-1])

    return decide


def _told(coefficients: Coefficients) -> Callable[[Array], Array]:
    """Return a function that returns, as a row, the decision that there are given leaks.

    Before `TOLD_AFTER_S` after the onset, its decision is that there is no leak.
    """

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
