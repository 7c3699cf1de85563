"""Records motions of a simulated rig, for studies and tests that replay the recordings."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import PLAIN, Guide
from estimator.filters.registry import start_memory
from rig.io.simulated import SimulatedRig, simulated_rig
from rig.loop.cycle import TRUTH
from rig.loop.simulated_loop import Motion, SimulatedLoop
from rig.plant import FAULT_COLUMNS, LEAKS, Model, Parameters
from rig.recording import Recording

from .drawn_rigs import MIDDLE

Array = NDArray[np.float64]

TRUE_LEAKS: Final[Mapping[str, str]] = dict(zip(LEAKS, TRUTH[-len(LEAKS) :], strict=True))
"""Name of the channel with the true flow (m^3/s) of each leak, by the leak's name."""
SETTLE_TICKS: Final = 2000
"""Ticks in which the ram goes to the start of its motion and settles there."""


def recorded_healthy(truth: Parameters, setpoint: Array, open_loop: bool, seed: int) -> Recording:
    """Return the recording of a rig without faults in a motion that starts at `MIDDLE`.

    Args:
        truth: true parameters of the rig.
        setpoint: float64 (ticks,), m, or V in open loop.
        open_loop: whether the setpoint is the command.
        seed: draws the transducers' noise.
    """
    faults = np.zeros((setpoint.size, len(FAULT_COLUMNS)))
    motion = Motion(setpoint, open_loop, faults, MIDDLE, SETTLE_TICKS)
    return recorded(simulated_rig(Model(parameters=truth), seed), motion)


def recorded(rig: SimulatedRig, motion: Motion, guide: Guide = PLAIN) -> Recording:
    """Bring a rig to the start of a motion, run the motion, and return its recording.

    The product filter runs along and assumes the nominal model. The recording holds all channels
    of the loop, including the truth, but not the way to the start. `guide` is what the position
    loop adds to gain times error.
    """
    model = Model()
    loop = SimulatedLoop(rig, motion, start_memory("product", model), model.parameters,
                         guide=guide)  # fmt: skip
    loop.position()
    rows = loop.advance(motion.setpoint.size)
    return Recording({name: rows[:, i] for i, name in enumerate(loop.channels)})
