"""Predictions of several runs of a plant side by side in lanes (`rig.lanes`), compiled.

As `prediction` makes them one by one, but for the last digits: one recording with the same gains
and other parameters in each lane, or one filter whose derivatives by the states are the lanes.
"""

from math import sqrt
from typing import Final

import numpy as np
from numba import float64, types, void

from estimator.gap.plant import (
    DRIVE_IN_LANES,
    READ,
    READ_IN_LANES,
    REMEMBER,
    REMEMBER_IN_LANES,
    STEP_IN_LANES,
)
from rig.jit import njit
from rig.lanes import LANES, align_stack, empty_lanes, load, store

from .prediction import SETUP, TRACK, Begun, correct, predict_covariance, put

_VECTOR: Final = float64[::1]
_MATRIX: Final = float64[:, ::1]
_CUBE: Final = float64[:, :, ::1]
_DRIVE: Final = types.FunctionType(DRIVE_IN_LANES)
_STEP: Final = types.FunctionType(STEP_IN_LANES)
_REMEMBER: Final = types.FunctionType(REMEMBER_IN_LANES)
_READ: Final = types.FunctionType(READ_IN_LANES)
_REMEMBER_ALONE: Final = types.FunctionType(REMEMBER)
_READ_ALONE: Final = types.FunctionType(READ)
_BEGUN: Final = types.BaseTuple.from_types((_MATRIX, _MATRIX, _MATRIX), Begun)


@njit(
    void(_DRIVE, _STEP, _REMEMBER, _READ, TRACK, _BEGUN, _VECTOR, _CUBE),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_frozen_in_lanes(drive, step, remember, read, track, begun, first, innovations):
    """Predict a recording one sample ahead with given gains, with other parameters in each lane.

    Args:
        drive: of `InLanes`.
        step: likewise.
        remember: likewise.
        read: likewise.
        track: of the record.
        begun: plants at its first sample, in lanes; the states after the recording are left there.
        first: float64 (parameters,), those of the first lane.
        innovations: float64 (n, outputs, LANES), written: over their standard deviations, 0 if not
            used.
    """
    inputs, readings = track.inputs, track.readings
    gains, innovation_variances, couplings = track.gains, track.variances, track.couplings
    parameters, starts, memory = begun.parameters, begun.start, begun.memory
    count, outputs = starts.shape[0], readings.shape[1]
    align_stack()
    expected = empty_lanes(outputs)
    for t in range(inputs.shape[0]):
        read(starts, memory, parameters, first, expected)
        written = innovations[t]
        for i in range(outputs):
            variance = innovation_variances[t, i]
            if not variance < np.inf:
                for lane in range(LANES):
                    written[i, lane] = 0.0
                    expected[i, lane] = 0.0
                continue
            innovation = readings[t, i] - load(expected, i)
            for k in range(i):
                innovation -= couplings[t, i, k] * load(expected, k)
            store(expected, i, innovation)
            store(written, i, innovation / sqrt(variance))
            for j in range(count):
                store(starts, j, load(starts, j) + gains[t, i, j] * innovation)
        drive(inputs[t], memory)
        step(starts, memory, parameters, first)
        remember(starts, memory, parameters, first)


@njit(
    void(_DRIVE, _STEP, _REMEMBER, _REMEMBER_ALONE, _READ_ALONE, TRACK, SETUP, _MATRIX, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_filter_in_lanes(drive, step, remember, keep, read, track, setup, parameters, memory):
    """Run the filter over a recording as `run_filter` does, the derivatives of its step in lanes.

    Args:
        drive: of `InLanes`.
        step: likewise.
        remember: likewise.
        keep: as `remember` of `run_filter`.
        read: as of `run_filter`.
        track: likewise.
        setup: likewise; its memory is of what the sensors keep.
        parameters: float64 (parameters, LANES), those of `setup` in all lanes.
        memory: float64 (rows, LANES), of `InLanes.begin`; of what reaches the plant.
    """
    inputs, outputs = track.inputs, track.readings.shape[1]
    first, changes, count = setup.parameters, setup.changes, setup.start.size
    remembered = setup.memory[0]
    x = setup.start.copy()
    ahead = np.empty(count)
    covariance = np.diag(setup.spread * setup.spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slope = np.empty((outputs, count))
    # Column 0 is the course itself, column 1 + j that with a change of state j.
    batches = (count + LANES) // LANES
    points = empty_lanes(batches * count).reshape((batches, count, LANES))
    for t in range(inputs.shape[0]):
        correct(read, remembered, setup, track, t, x, covariance, slope)
        drive(inputs[t], memory)
        for batch in range(batches):
            for i in range(count):
                for lane in range(LANES):
                    points[batch, i, lane] = x[i]
            for lane in range(LANES):
                j = batch * LANES + lane - 1
                if 0 <= j < count:
                    points[batch, j, lane] += changes[j]
            step(points[batch], memory, parameters, first)
        for i in range(count):
            ahead[i] = points[0, i, 0]
        for j in range(count):
            batch, lane = (1 + j) // LANES, (1 + j) % LANES
            for i in range(count):
                transition[i, j] = (points[batch, i, lane] - ahead[i]) / changes[j]
        predict_covariance(transition, setup.noises, product, covariance)
        remember(points[0], memory, parameters, first)
        keep(x, ahead, remembered, first)
        put(x, ahead)
