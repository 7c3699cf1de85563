"""The seven-state filter of the thesis for many independent rigs at once, one in each lane.

It is the step of `estimator.filters.thesis` itself, with lanes for floats (`rig.lanes`).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.lanes import LANES, align_stack, aligned, empty_lanes, in_lanes, load, store
from rig.plant import Model

from .registry import OUTPUTS
from .thesis import initial_state, thesis7_step

Array = NDArray[np.float64]

_STATES = 7


@njit(cache=True, error_model="numpy", nogil=True)
def thesis7_lane_ticks(x, covariance, held, readings, par, out, states):
    """Run the seven-state filter over samples of `LANES` rigs, each of them measured.

    Args:
        x: (7, LANES) states, updated.
        covariance: (7, 7, LANES), updated.
        held: (1, LANES) command since the last sample in V, updated.
        readings: (ticks, 6, LANES): position, pressures 1 and 2, two not used, and the command from
            there on.
        par: `Parameters` that all filters assume.
        out: (9, LANES), outputs of the last sample.
        states: (ticks, 7, LANES), to be filled with the estimates.
    """
    align_stack()
    for k in range(readings.shape[0]):
        z = readings[k]
        position, p1, p2 = load(z, 0), load(z, 1), load(z, 2)
        thesis7_step(in_lanes(x), in_lanes(covariance), load(held, 0), position, p1, p2,
                     par, in_lanes(out))  # fmt: skip
        for i in range(_STATES):
            store(states[k], i, load(x, i))
        store(held, 0, load(z, 5))


class Thesis7Lanes:
    """The seven-state filters of `LANES` rigs that all assume one model.

    Args:
        model: what the filters assume.
    """

    def __init__(self, model: Model) -> None:
        x, covariance = initial_state(with_load=True)
        self._x = aligned(np.repeat(x[:, None], LANES, axis=1))
        self._covariance = aligned(np.repeat(covariance[:, :, None], LANES, axis=2))
        self._parameters = model.parameters
        self._held = aligned(np.zeros((1, LANES)))
        self._out = aligned(np.zeros((len(OUTPUTS), LANES)))
        self._started = False

    def advance(self, readings: Array) -> Array:
        """Take samples (ticks, 6, LANES) as of `SimulatedLanes` and return the estimates.

        The first sample ever starts the filters: its command holds from there on. Returns float64
        (ticks, 7, LANES).
        """
        states = empty_lanes(readings.shape[0] * _STATES).reshape((-1, _STATES, LANES))
        first = 0 if self._started else 1
        if not self._started:
            states[0] = self._x
            self._held[0] = readings[0, -1]
            self._started = True
        thesis7_lane_ticks(
            self._x, self._covariance, self._held, readings[first:], self._parameters,
            self._out, states[first:],
        )  # fmt: skip
        return states
