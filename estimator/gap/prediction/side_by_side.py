"""Compiled functions here predict several runs of a plant side by side in lanes (`rig.lanes`).

The results are those of `prediction` except for the last digits. Either each lane runs the same
recording with the same gains and its own parameters, or the lanes are the derivatives of one filter
by its states.
"""

from math import sqrt
from typing import Final

import numpy as np
from numba import int64, types, void

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

from .added_in_lanes import follow_course, lanes_scratch_of, read_lanes, remember_lanes, step_lanes
from .prediction import (
    ALONG,
    CUBE,
    MATRIX,
    SETUP,
    SLOPES,
    TRACK,
    VECTOR,
    Begun,
    correct,
    predict_covariance,
)
from .with_additions import put, remember_with, scratch_of

_DRIVE, _STEP, _REMEMBER, _READ = (
    types.FunctionType(each)
    for each in (DRIVE_IN_LANES, STEP_IN_LANES, REMEMBER_IN_LANES, READ_IN_LANES)
)
_ALONE: Final = tuple(types.FunctionType(each) for each in (REMEMBER, READ, MEASURE))
_MEASURE: Final = _ALONE[-1]
_BEGUN: Final = types.BaseTuple.from_types((MATRIX, MATRIX, MATRIX, EXTENSION), Begun)
_FROZEN: Final = void(_DRIVE, _STEP, _REMEMBER, _READ, _MEASURE, TRACK, _BEGUN, VECTOR, CUBE)
_FILTER: Final = void(_DRIVE, _STEP, _REMEMBER, *_ALONE, TRACK, SETUP, MATRIX, MATRIX, int64[::1])
_LINEARISE: Final = void(
    _DRIVE, _STEP, _REMEMBER, _READ, _MEASURE, ALONG, CUBE, VECTOR, MATRIX, VECTOR, SLOPES
)


@njit(_FROZEN, cache=True, error_model="numpy", nogil=True)
def run_frozen_in_lanes(drive, step, remember, read, measures, track, begun, first, innovations):
    """Predict a recording one sample ahead with given gains and with other parameters in each lane.

    Args:
        drive: as in `InLanes`.
        step: as in `InLanes`.
        remember: as in `InLanes`.
        read: as in `InLanes`.
        measures: function of the plant, compiled with MEASURE.
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
    extension, expected = begun.extension, empty_lanes(outputs)
    scratch = lanes_scratch_of(
        parameters.reshape((1, parameters.shape[0], LANES)), extension, count, outputs
    )
    for t in range(inputs.shape[0]):
        read_lanes(
            read, measures, extension, scratch, 0, t, starts, inputs[t], memory, parameters,
            first, expected,
        )  # fmt: skip
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
        step_lanes(
            step, measures, extension, scratch, 0, t, starts, inputs[t], memory, parameters, first
        )
        remember_lanes(
            remember, measures, extension, scratch, 0, starts, inputs[t], memory, parameters, first
        )


@njit(_FILTER, cache=True, error_model="numpy", nogil=True)
def run_filter_in_lanes(
    drive, step, remember, keep, read, measures, track, setup, parameters, memory, acting
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
        acting: int64 (k,), states that derivatives are taken by (`InLanes.acting`); those by the
            others are 0.
    """
    inputs, outputs = track.inputs, track.readings.shape[1]
    first, changes, count = setup.parameters, setup.changes, setup.start.size
    remembered, extension = setup.memory[0], setup.extension
    scratch = scratch_of(first, extension)
    beside = lanes_scratch_of(
        parameters.reshape((1, parameters.shape[0], LANES)), extension, count, outputs
    )
    x = setup.start.copy()
    ahead = np.empty(count)
    covariance = np.diag(setup.spread * setup.spread)
    transition, product = np.zeros((count, count)), np.empty((count, count))
    slope = np.empty((outputs, count))
    # Column 0 is the course itself; column 1 + k is the course with a change of state acting[k].
    batches = (acting.size + LANES) // LANES
    points = empty_lanes(batches * count).reshape((batches, count, LANES))
    for t in range(inputs.shape[0]):
        correct(read, measures, scratch, remembered, setup, track, t, x, covariance, slope)
        drive(inputs[t], memory)
        for batch in range(batches):
            for i in range(count):
                for lane in range(LANES):
                    points[batch, i, lane] = x[i]
            for lane in range(LANES):
                k = batch * LANES + lane - 1
                if 0 <= k < acting.size:
                    points[batch, acting[k], lane] += changes[acting[k]]
            step_lanes(
                step, measures, extension, beside, 0, t, points[batch], inputs[t], memory,
                parameters, first,
            )  # fmt: skip
        for i in range(count):
            ahead[i] = points[0, i, 0]
        for k in range(acting.size):
            j, batch, lane = acting[k], (1 + k) // LANES, (1 + k) % LANES
            for i in range(count):
                transition[i, j] = (points[batch, i, lane] - ahead[i]) / changes[j]
        predict_covariance(transition, acting, setup.noises, product, covariance)
        remember(points[0], memory, parameters, first)
        remember_with(keep, measures, extension, scratch, x, ahead, inputs[t], remembered, first)
        follow_course(extension, scratch.followed, beside)
        put(x, ahead)


@njit(_LINEARISE, cache=True, error_model="numpy", nogil=True)
def linearise_in_lanes(
    drive, step, remember, read, measures, along, parameters, first, memory, changes, written
):
    """Linearise a plant along a filtered course, as `sensitivities.linearise_course` does.

    Args:
        drive: as in `InLanes`.
        step: as in `InLanes`.
        remember: as in `InLanes`.
        read: as in `InLanes`.
        measures: function of the plant, compiled with MEASURE.
        along: the course.
        parameters: float64 (1 + batches, parameters, LANES). The first has the present values in
            all lanes. In the others, lane 0 has the present values, and the other lanes have, one
            after the other, the present values for each state, then the changes of each probe.
        first: float64 (parameters,), the present values.
        memory: float64 (rows, LANES), of `InLanes.begin` with the present values in all lanes;
            changed.
        changes: float64 (k,), changes of the states by which derivatives are taken.
        written: the linearisation, which is written.
    """
    inputs, states, places = along.inputs, along.states, along.places
    transitions, slopes, shifts = written.transitions, written.slopes, written.shifts
    count, outputs, probes = states.shape[1], slopes.shape[1], shifts.shape[2]
    batches, extension = parameters.shape[0] - 1, along.extension
    align_stack()
    scratch = lanes_scratch_of(parameters, extension, count, outputs)
    course = empty_lanes(count)
    points = empty_lanes(batches * count).reshape((batches, count, LANES))
    shown = empty_lanes(batches * outputs).reshape((batches, outputs, LANES))
    for t in range(states.shape[0]):
        row = places[t]
        if row >= 0:
            for batch in range(batches):
                for i in range(count):
                    for lane in range(LANES):
                        points[batch, i, lane] = states[t, i]
                for lane in range(1, LANES):
                    j = batch * (LANES - 1) + lane - 1
                    if j < count:
                        points[batch, j, lane] += changes[j]
                read_lanes(
                    read, measures, extension, scratch, 1 + batch, t, points[batch], inputs[t],
                    memory, parameters[1 + batch], first, shown[batch],
                )  # fmt: skip
        drive(inputs[t], memory)
        if row >= 0:
            for batch in range(batches):
                step_lanes(
                    step, measures, extension, scratch, 1 + batch, t, points[batch], inputs[t],
                    memory, parameters[1 + batch], first,
                )  # fmt: skip
                for lane in range(1, LANES):
                    j = batch * (LANES - 1) + lane - 1
                    if j < count:
                        for i in range(count):
                            moved = points[batch, i, lane] - points[batch, i, 0]
                            transitions[row, i, j] = moved / changes[j]
                        for i in range(outputs):
                            moved = shown[batch, i, lane] - shown[batch, i, 0]
                            slopes[row, i, j] = moved / changes[j]
                    elif j < count + probes:
                        p = j - count
                        for i in range(count):
                            shifts[row, i, p] = points[batch, i, lane] - points[batch, i, 0]
                        for i in range(outputs):
                            moved = shown[batch, i, lane] - shown[batch, i, 0]
                            shifts[row, count + i, p] = moved
        # Each step changes the memory, so that the last step must be that of the course itself.
        for i in range(count):
            for lane in range(LANES):
                course[i, lane] = states[t, i]
        step_lanes(
            step, measures, extension, scratch, 0, t, course, inputs[t], memory, parameters[0],
            first,
        )  # fmt: skip
        remember_lanes(
            remember, measures, extension, scratch, 0, course, inputs[t], memory, parameters[0],
            first,
        )  # fmt: skip
