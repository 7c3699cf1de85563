"""Open-loop simulation: the true motion of a rig under a given command, without sensors."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit

from .command_effects import command_path, drive
from .dynamics import STATE_COUNT, PlantState, rest_state
from .effects import Model
from .faults import NO_FAULT
from .integrator import SUBSTEPS

Array = NDArray[np.float64]


@njit(cache=True, error_model="numpy", nogil=True)
def _simulate(state, path, command, par, faults, substeps, states):
    for k in range(command.size):
        for i in range(STATE_COUNT):
            states[k, i] = state[i]
        drive(state, path, command[k], par, faults[k % faults.shape[0]], substeps)


def simulate(
    model: Model,
    command: Array,
    *,
    initial: Array | Sequence[float] | None = None,
    position: float = 0.3,
    faults: Array | None = None,
    substeps: int = SUBSTEPS,
    start_s: float = 0.0,
) -> dict[str, Array]:
    """Return the true motion of a rig that is simulated in open loop at 1 kHz.

    With a command delay, the command before the first sample is 0 V.

    Args:
        model: model of the rig.
        command: float64 (n,), valve command in V; value k acts from k ms to k + 1 ms.
        initial: true state (9,) at the start; None for a ram at rest at `position`.
        position: position in m of the ram at rest; without effect if `initial` is given.
        faults: fault coefficients, float64 (n, 8) or, if constant, (1, 8), columns as
            `rig.plant.faults.FAULT_COLUMNS`; None for a rig without faults.
        substeps: least number of integration steps per millisecond.
        start_s: time of the first sample, s; the phase of a supply ripple counts from time 0.

    Returns:
        Each state at times 0, 1, ... n - 1 ms from the start, float64 (n,), SI, by its name in
        `PlantState`.

    Raises:
        ValueError: the fault table or the initial state has the wrong shape.
    """
    command = np.ascontiguousarray(command, dtype=np.float64)
    table = np.array([NO_FAULT]) if faults is None else np.ascontiguousarray(faults)
    if table.shape not in ((1, len(NO_FAULT)), (command.size, len(NO_FAULT))):
        raise ValueError(
            f"faults: shape {table.shape} does not match {command.size} ticks of "
            f"{len(NO_FAULT)} coefficients; give one row a tick"
        )
    start = rest_state(model.parameters, position) if initial is None else np.array(initial)
    if start.shape != (STATE_COUNT,):
        raise ValueError(f"initial: shape {start.shape}; the plant has {STATE_COUNT} states")
    states = np.empty((command.size, STATE_COUNT))
    path = command_path(model.parameters, spool=float(start[0]), time_s=start_s)
    _simulate(start.astype(np.float64), path, command, model.parameters, table, substeps, states)
    return dict(zip(PlantState._fields, np.ascontiguousarray(states.T), strict=True))
