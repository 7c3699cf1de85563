"""The loop on the simulated backend: compiled ticks in batches of whatever length is asked for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from estimator.filters import FilterMemory, FilterRun
from estimator.flow_account import BLOCK_TICKS
from rig.io.simulated import SimulatedRig
from rig.plant import NO_FAULT, Parameters
from rig.plant.integrator import TICK

from .cycle import position_ticks, row_channels, simulated_ticks
from .decided import no_decision
from .ladder import Action, Cause
from .reaction import Reaction, reaction_memory
from .trip import LoopStoppedError

Array = NDArray[np.float64]

_RAMP_PART = 0.75
"""Part of the settling time in which the ram moves to its start; the rest lets it come to rest."""


@dataclass(frozen=True)
class Motion:
    """What a test asks of the ram, tick by tick.

    Attributes:
        setpoint: float64 (ticks,), m in closed loop, V in open loop.
        open_loop: whether the setpoint is the valve command itself.
        faults: float64 (ticks, 8), coefficients (`rig.plant.faults.FAULT_COLUMNS`).
        start_position: where the ram is brought before the first tick, m.
        settle_ticks: ticks that this may take.
    """

    setpoint: Array
    open_loop: bool
    faults: Array
    start_position: float
    settle_ticks: int


def raised_cosine(start: float, end: float, ticks: int) -> Array:
    """Return setpoints (ticks,) from start to end along a raised cosine, with a rest at the end."""
    ramp = max(int(_RAMP_PART * ticks), 1)
    progress = np.minimum(np.arange(ticks) / ramp, 1.0)
    return start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * progress))


class SimulatedLoop:
    """One test on a simulated rig, advanced any number of ticks at a time.

    Args:
        rig: the simulated rig; its state is the loop's to change.
        motion: setpoint and faults of every tick.
        memory: the filter's memory, before its first sample.
        assumed: the parameters the filter assumes.
        gain: position loop, V/m.
        limit: greatest command of either sign, V.
        on_fault: what is done about a confirmed fault.

    Raises:
        ValueError: setpoint and fault table differ in length.
    """

    def __init__(
        self,
        rig: SimulatedRig,
        motion: Motion,
        memory: FilterMemory,
        assumed: Parameters,
        *,
        gain: float = POSITION_GAIN,
        limit: float = COMMAND_LIMIT,
        on_fault: Reaction = Reaction.IGNORE,
    ) -> None:
        if motion.faults.shape != (motion.setpoint.size, len(NO_FAULT)):
            raise ValueError(
                f"fault table {motion.faults.shape} does not fit {motion.setpoint.size} setpoints"
            )
        self._rig = rig
        self._motion = motion
        self._memory = memory
        self._assumed = assumed
        self._gain, self._limit = gain, limit
        self._held = np.zeros(1)
        self._tick = 0
        self._on_fault = int(on_fault)
        self._decided = no_decision()
        self._reaction = reaction_memory()
        self.channels = row_channels(memory.filter.states, motion.open_loop)

    @property
    def ticks_left(self) -> int:
        """Ticks of the test that are still to run."""
        return self._motion.setpoint.size - self._tick

    def position(self) -> None:
        """Bring the ram to its start by the position loop, along a raised cosine; let it rest."""
        setpoint = raised_cosine(
            self._rig.state[4], self._motion.start_position, self._motion.settle_ticks
        )
        rig = self._rig
        rig.start_clock(-setpoint.size * TICK)
        # A plain tuple, as in the test's ticks: another type would be another compilation.
        position_ticks(setpoint, self._gain, self._limit, tuple(NO_FAULT), rig.state, rig.path,
                       rig.seen, rig.parameters, rig.sensors, self._held)  # fmt: skip
        rig.start_clock(0.0)

    def advance(self, ticks: int) -> Array:
        """Run up to `ticks` ticks and return their rows, float64 (n, columns of `channels`).

        Raises:
            LoopStoppedError: a fault was confirmed, and is to trip; rows up to then were returned.
        """
        count = min(ticks, self.ticks_left)
        part = slice(self._tick, self._tick + count)
        rig, memory, motion = self._rig, self._memory, self._motion
        rows = np.empty((count, len(self.channels)))
        done = simulated_ticks(
            self._tick, TICK, motion.setpoint[part], motion.open_loop, self._gain, self._limit,
            motion.faults[part], rig.state, rig.path, rig.seen, rig.parameters, rig.sensors,
            rig.fitted, rig.meters, rig.offsets, rig.noise(count), memory.filter.code, memory.x,
            memory.covariance, self._assumed, memory.noise, memory.work, self._on_fault,
            self._decided, self._reaction, self._held, rows,
        )  # fmt: skip
        self._tick += done
        if count and not done:
            raise LoopStoppedError(Action.TRIP, Cause.FAULT_CONFIRMED)
        return rows[:done]

    def decided(self, row: Array) -> None:
        """Take a decision, a row of `DECIDED`, which all rows from now on carry."""
        self._decided = row

    def safe_state(self) -> None:
        """Put the valve at null and take every injected fault away."""
        self._held[0] = 0.0
        self._motion.faults[self._tick :] = 0.0


def estimates_in(rows: Array, channels: tuple[str, ...], memory: FilterMemory) -> FilterRun:
    """Return the filter's estimates that a batch of rows holds, for a detector."""
    outputs = channels.index("innovation_position_m")
    states = channels.index(f"est_{memory.filter.states[0]}")
    return FilterRun(
        memory.filter,
        rows[:, 0],
        rows[:, states : states + len(memory.filter.states)],
        rows[:, outputs:states],
        memory.dense_covariance,
    )


def batch_ticks(first: bool) -> int:
    """Return the ticks of one batch: half a second, and one more to start with.

    Oil accounts run from sample to sample, so that the first block needs the sample before it.
    """
    return BLOCK_TICKS + 1 if first else BLOCK_TICKS
