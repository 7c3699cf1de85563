"""Compiled functions here predict several runs of a plant side by side in lanes (`rig.lanes`).

The results are those of `prediction` except for the last digits. Either each lane runs the same
recording with the same gains and its own parameters, or the lanes are the derivatives of one filter
by its states.
"""

from math import sqrt
from typing import Final

import numpy as np
from numba import types, void

from estimator.gap.plant import (
    DRIVE_IN_LANES,
    EXTENSION,
    MEASURE,
    READ,
    READ_IN_LANES,
    REMEMBER,
    REMEMBER_IN_LANES,
    STEP_IN_LANES,
)
from rig.jit import njit
from rig.lanes import LANES, align_stack, empty_lanes, load, store

from .prediction import CUBE, MATRIX, SETUP, TRACK, VECTOR, Begun, correct, predict_covariance
from .with_additions import put, scratch_of

_DRIVE, _STEP, _REMEMBER, _READ = (
    types.FunctionType(each)
    for each in (DRIVE_IN_LANES, STEP_IN_LANES, REMEMBER_IN_LANES, READ_IN_LANES)
)
_ALONE: Final = tuple(types.FunctionType(each) for each in (REMEMBER, READ, MEASURE))
_BEGUN: Final = types.BaseTuple.from_types((MATRIX, MATRIX, MATRIX, EXTENSION), Begun)
_FROZEN: Final = void(_DRIVE, _STEP, _REMEMBER, _READ, TRACK, _BEGUN, VECTOR, CUBE)
_FILTER: Final = void(_DRIVE, _STEP, _REMEMBER, *_ALONE, TRACK, SETUP, MATRIX, MATRIX)


@njit(_FROZEN, cache=True, error_model="numpy", nogil=True)
def run_frozen_in_lanes(drive, step, remember, read, track, begun, first, innovations):
    """Predict a recording one sample ahead with given gains and with other parameters in each lane.

    Args:
        drive: as in `InLanes`.
        step: as in `InLanes`.
        remember: as in `InLanes`.
        read: as in `InLanes`.
        track: the record and its gains.
        begun: the plants at the first sample, in lanes; its start is overwritten by the states
            after the recording, and its memory is changed.
        first: float64 (parameters,), parameters of the first lane.
        innovations: float64 (n, outputs, LANES), written: divided by their standard deviations, 0
            where a reading is not used.
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


@njit(_FILTER, cache=True, error_model="numpy", nogil=True)
def run_filter_in_lanes(
    drive, step, remember, keep, read, measures, track, setup, parameters, memory
):
    """Run the filter over a recording as `run_filter` does, with its step's derivatives in lanes.

    Args:
        drive: as in `InLanes`.
        step: as in `InLanes`.
        remember: as in `InLanes`.
        keep: the function `remember` of a plant that runs alone, compiled with REMEMBER.
        read: the function `read` of a plant that runs alone, compiled with READ.
        measures: function of the plant, compiled with MEASURE.
        track: the record; its gains are written.
        setup: settings of the filter; its memory serves `keep` and `read`, for the readings.
        parameters: float64 (parameters, LANES), those of `setup` in all lanes.
        memory: float64 (rows, LANES), of `InLanes.begin`; it serves the step, and is changed.
    """
    inputs, outputs = track.inputs, track.readings.shape[1]
    first, changes, count = setup.parameters, setup.changes, setup.start.size
    remembered, scratch = setup.memory[0], scratch_of(first, setup.extension)
    x = setup.start.copy()
    ahead = np.empty(count)
    covariance = np.diag(setup.spread * setup.spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slope = np.empty((outputs, count))
    # Column 0 is the course itself; column 1 + j is the course with a change of state j.
    batches = (count + LANES) // LANES
    points = empty_lanes(batches * count).reshape((batches, count, LANES))
    for t in range(inputs.shape[0]):
        correct(read, measures, scratch, remembered, setup, track, t, x, covariance, slope)
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
