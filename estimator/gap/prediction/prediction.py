"""Compiled functions here predict a recording one sample ahead by an extended Kalman filter.

They work for any plant. A first run computes how strongly each reading corrects each state, the
gains (`run_filter`). Further runs keep these gains (`run_frozen`): their predictions depend on the
parameters alone, and cost a fiftieth. Fits and derivatives by parameters are made of such runs
(prediction-error method, Ljung 1999, ch. 7).
"""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import float64, int64, types, void
from numpy.typing import NDArray

from estimator.gap.plant import DRIVE, EXTENSION, MEASURE, READ, REMEMBER, STEP, Array, Extension
from rig.jit import njit
from rig.plant import inner

from .with_additions import drive_with, put, read_with, remember_with, scratch_of, step_with

PLANT: Final = tuple(types.FunctionType(each) for each in (DRIVE, STEP, REMEMBER, READ, MEASURE))
"""Types of the functions of a plant, in the order in which compiled functions here take them."""
VECTOR: Final = float64[::1]
MATRIX: Final = float64[:, ::1]
CUBE: Final = float64[:, :, ::1]


class Track(NamedTuple):
    """A record, and the gains of a filter along it.

    Attributes:
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        gains: float64 (n, outputs, states), change of a state by an innovation of one SI unit.
        variances: float64 (n, outputs), of the innovations; infinite where a reading is not used.
        couplings: float64 (n, outputs, outputs), [t, i, k] is the change of the prediction of
            reading i by one SI unit of innovation k of the same sample, which is applied before it
            (k < i, else 0).
    """

    inputs: Array
    readings: Array
    gains: Array
    variances: Array
    couplings: Array


class Setup(NamedTuple):
    """The settings of a filter, apart from the record.

    Attributes:
        variances: float64 (n, outputs), of the readings; infinite where a reading is not to be
            used.
        parameters: float64 (parameters,), of the plant.
        start: float64 (states,), state at the first sample.
        spread: float64 (states,), standard deviations of `start`.
        changes: float64 (states,), changes of the states by which derivatives are taken.
        noises: float64 (states,), variances of the model's error over one sample.
        shares: float64 (outputs, states), part of the optimal gains that is used.
        memory: float64 (1, length), of `Plant.begin`; a run changes it.
        extension: what the model's additions need.
    """

    variances: Array
    parameters: Array
    start: Array
    spread: Array
    changes: Array
    noises: Array
    shares: Array
    memory: Array
    extension: Extension


class Begun(NamedTuple):
    """A plant at the first sample of a record. In lanes, each array has LANES columns.

    Attributes:
        parameters: float64 (parameters,), in lanes (parameters, LANES).
        start: float64 (states,), in lanes (states, LANES).
        memory: float64 (1, length), of `Plant.begin`; in lanes (rows, LANES), of `InLanes.begin`. A
            run changes it.
        extension: what the model's additions need; runs in lanes have none.
    """

    parameters: Array
    start: Array
    memory: Array
    extension: Extension


class Along(NamedTuple):
    """The course along which a plant is linearised.

    Attributes:
        inputs: float64 (n, inputs).
        states: float64 (n, k), filtered.
        places: int64 (n,), row of the results for each sample; -1 where no result is wanted.
        extension: what the model's additions need.
    """

    inputs: Array
    states: Array
    places: NDArray[np.int64]
    extension: Extension


class Slopes(NamedTuple):
    """The matrices of a linearisation.

    Attributes:
        transitions: float64 (m, k, k), derivatives of the state after the step by the state before
            it.
        slopes: float64 (m, outputs, k), derivatives of the readings by the state.
        shifts: float64 (m, k + outputs, probes), what each probe adds to the state after the step,
            and to the readings.
    """

    transitions: Array
    slopes: Array
    shifts: Array


TRACK: Final = types.BaseTuple.from_types((MATRIX, MATRIX, CUBE, MATRIX, CUBE), Track)
SETUP: Final = types.BaseTuple.from_types(
    (MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, MATRIX, MATRIX, EXTENSION), Setup
)
ALONG: Final = types.BaseTuple.from_types((MATRIX, MATRIX, int64[::1], EXTENSION), Along)
SLOPES: Final = types.BaseTuple.from_types((CUBE, CUBE, CUBE), Slopes)
_BEGUN: Final = types.BaseTuple.from_types((VECTOR, VECTOR, MATRIX, EXTENSION), Begun)
_AHEAD: Final = void(*PLANT, MATRIX, MATRIX, _BEGUN, int64, MATRIX)
_FREE: Final = void(*PLANT, MATRIX, MATRIX, _BEGUN, MATRIX, MATRIX)


@njit(cache=True, error_model="numpy", forceinline=True)
def _advance(
    drive, step, remember, measures, extension, scratch, t, before, x, inputs, memory, parameters
):
    """Write to `x` the state (count,) one sample after `before`; update the memory (length,)."""
    drive_with(drive, measures, extension, scratch, t, before, inputs, memory, parameters)
    step_with(step, measures, extension, scratch, t, before, x, inputs, memory, parameters)
    remember_with(remember, measures, extension, scratch, before, x, inputs, memory, parameters)


@inner
def correct(read, measures, scratch, memory, setup, track, t, x, covariance, slope):
    """Correct a state and its covariance in place by the readings of one sample; write the gains.

    The readings are applied one after the other (Bierman 1977, ch. 2), each linearised about the
    prediction. A reading with an infinite variance is not used: its gains are 0. The covariance is
    right for the gains that are used, even if they are only a part of the optimal ones (Joseph's
    form).

    Args:
        read: function of the plant, compiled with READ.
        measures: function of the plant, compiled with MEASURE.
        scratch: arrays for the additions.
        memory: float64 (length,).
        setup: settings of the filter.
        track: the record; the gains, variances and couplings of the sample are written.
        t: index of the sample.
        x: float64 (states,), predicted state; corrected in place.
        covariance: float64 (states, states); corrected in place.
        slope: float64 (outputs, states), written: derivatives of the readings by the state.
    """
    parameters, changes, shares = setup.parameters, setup.changes, setup.shares
    readings, variances = track.readings[t], setup.variances[t]
    gains, innovation_variances = track.gains[t], track.variances[t]
    couplings = track.couplings[t]
    count, outputs = x.size, readings.size
    expected, shifted = np.empty(outputs), np.empty(outputs)
    ahead, acting = np.empty(count), np.empty(count, dtype=np.int64)
    point = x.copy()
    extension, inputs = setup.extension, track.inputs[t]
    read_with(read, measures, extension, scratch, t, x, inputs, memory, parameters, expected)
    for j in range(count):
        point[j] = x[j] + changes[j]
        read_with(read, measures, extension, scratch, t, point, inputs, memory, parameters, shifted)
        point[j] = x[j]
        for i in range(outputs):
            slope[i, j] = (shifted[i] - expected[i]) / changes[j]
    for i in range(outputs):
        for k in range(outputs):
            couplings[i, k] = 0.0
        variance = variances[i]
        if not variance < np.inf:
            innovation_variances[i] = np.inf
            gains[i, :] = 0.0
            continue
        innovation = readings[i] - expected[i]
        # Most readings depend on one state alone.
        few = 0
        for k in range(count):
            if slope[i, k] != 0.0:
                acting[few] = k
                few += 1
        for j in range(count):
            innovation -= slope[i, j] * (x[j] - point[j])
            total = 0.0
            for n in range(few):
                k = acting[n]
                total += covariance[j, k] * slope[i, k]
            ahead[j] = total
            variance += slope[i, j] * total
        innovation_variances[i] = variance
        for k in range(i):
            for n in range(few):
                j = acting[n]
                couplings[i, k] += slope[i, j] * gains[k, j]
        whole = True
        for j in range(count):
            gains[i, j] = ahead[j] / variance
            if shares[i, j] != 1.0:
                gains[i, j] *= shares[i, j]
                whole = False
            x[j] += gains[i, j] * innovation
        for j in range(count):
            gain = gains[i, j]
            for k in range(count):
                covariance[j, k] -= gain * ahead[k]
            if not whole:
                rest = ahead[j] - gain * variance
                for k in range(count):
                    covariance[j, k] -= rest * gains[i, k]


@inner
def predict_covariance(transition, acting, noises, product, covariance):
    """Advance a covariance (states, states) in place by one sample, before the next readings.

    Args:
        transition: float64 (states, states), derivatives of the state after the step by that
            before; the columns of states that are not in `acting` are 0.
        acting: int64 (k,), ascending indices of states.
        noises: float64 (states,), variances of the model's error over one sample.
        product: float64 (states, states), scratch.
        covariance: float64 (states, states); updated.
    """
    count = noises.size
    # The inner loops run along rows, so that the processor adds several numbers at once.
    for i in range(count):
        for j in range(count):
            product[i, j] = 0.0
        for k in acting:
            rate = transition[i, k]
            for j in range(count):
                product[i, j] += rate * covariance[k, j]
    turned = transition.T.copy()
    for i in range(count):
        for j in range(count):
            covariance[i, j] = 0.0
        for k in acting:
            part = product[i, k]
            for j in range(i + 1):
                covariance[i, j] += part * turned[k, j]
    for i in range(count):
        for j in range(i):
            covariance[j, i] = covariance[i, j]
        covariance[i, i] += noises[i]


@njit(void(*PLANT, TRACK, SETUP), cache=True, error_model="numpy", nogil=True)
def run_filter(drive, step, remember, read, measures, track, setup):
    """Run the filter over a recording, and write its gains to the track.

    Args:
        drive: function of the plant, compiled with DRIVE.
        step: function of the plant, compiled with STEP.
        remember: function of the plant, compiled with REMEMBER.
        read: function of the plant, compiled with READ.
        measures: function of the plant, compiled with MEASURE.
        track: the record; its gains, variances and couplings are written.
        setup: settings of the filter; its memory is changed.
    """
    inputs, outputs = track.inputs, track.readings.shape[1]
    parameters, changes, count = setup.parameters, setup.changes, setup.start.size
    remembered = setup.memory[0]
    x, extension = setup.start.copy(), setup.extension
    scratch = scratch_of(parameters, extension)
    point, moved, ahead = np.empty(count), np.empty(count), np.empty(count)
    covariance = np.diag(setup.spread * setup.spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slope, every = np.empty((outputs, count)), np.arange(count)
    for t in range(inputs.shape[0]):
        now = inputs[t]
        correct(read, measures, scratch, remembered, setup, track, t, x, covariance, slope)
        drive_with(drive, measures, extension, scratch, t, x, now, remembered, parameters)
        step_with(step, measures, extension, scratch, t, x, ahead, now, remembered, parameters)
        for j in range(count):
            put(moved, x)
            moved[j] += changes[j]
            step_with(
                step, measures, extension, scratch, t, moved, point, now, remembered, parameters
            )
            for i in range(count):
                transition[i, j] = (point[i] - ahead[i]) / changes[j]
        predict_covariance(transition, every, setup.noises, product, covariance)
        remember_with(remember, measures, extension, scratch, x, ahead, now, remembered, parameters)
        put(x, ahead)


@njit(void(*PLANT, TRACK, _BEGUN, MATRIX, MATRIX), cache=True, error_model="numpy", nogil=True)
def run_frozen(drive, step, remember, read, measures, track, begun, innovations, states):
    """Predict a recording one sample ahead with given gains.

    Args:
        drive: as in `run_filter`.
        step: as in `run_filter`.
        remember: as in `run_filter`.
        read: as in `run_filter`.
        measures: as in `run_filter`.
        track: the record and its gains.
        begun: the plant at the first sample; its memory is changed.
        innovations: float64 (n, outputs), written: divided by their standard deviations, 0 where a
            reading is not used.
        states: float64 (n, states), written: filtered states.
    """
    inputs, readings, parameters = track.inputs, track.readings, begun.parameters
    gains, innovation_variances, couplings = track.gains, track.variances, track.couplings
    count, outputs = begun.start.size, readings.shape[1]
    remembered = begun.memory[0]
    x, extension = begun.start.copy(), begun.extension
    scratch = scratch_of(parameters, extension)
    expected = np.empty(outputs)
    for t in range(inputs.shape[0]):
        now = inputs[t]
        read_with(read, measures, extension, scratch, t, x, now, remembered, parameters, expected)
        for i in range(outputs):
            variance = innovation_variances[t, i]
            if not variance < np.inf:
                innovations[t, i] = 0.0
                expected[i] = 0.0
                continue
            innovation = readings[t, i] - expected[i]
            # The readings that were applied before have corrected a part of it already, to first
            # order.
            for k in range(i):
                innovation -= couplings[t, i, k] * expected[k]
            expected[i] = innovation
            innovations[t, i] = innovation / sqrt(variance)
            for j in range(count):
                x[j] += gains[t, i, j] * innovation
        for j in range(count):
            states[t, j] = x[j]
        _advance(
            drive, step, remember, measures, extension, scratch, t, states[t], x, now,
            remembered, parameters,
        )  # fmt: skip


@njit(_AHEAD, cache=True, error_model="numpy", nogil=True)
def predict_ahead(drive, step, remember, read, measures, inputs, states, begun, horizon, predicted):
    """Predict readings freely, starting anew from the filtered state at every `horizon`-th sample.

    Args:
        drive: as in `run_filter`.
        step: as in `run_filter`.
        remember: as in `run_filter`.
        read: as in `run_filter`.
        measures: as in `run_filter`.
        inputs: float64 (n, inputs).
        states: float64 (n, states), filtered states of `run_frozen`.
        begun: the plant at the first sample; its memory is changed.
        horizon: number of samples from one start to the next.
        predicted: float64 (n, outputs), written; NaN at the samples of the starts.
    """
    parameters, remembered = begun.parameters, begun.memory[0]
    extension, scratch = begun.extension, scratch_of(parameters, begun.extension)
    free, scratch_free = remembered.copy(), scratch_of(parameters, begun.extension)
    x, expected = begun.start.copy(), np.empty(predicted.shape[1])
    ahead = np.empty(x.size)
    for t in range(inputs.shape[0]):
        if t % horizon == 0:
            put(x, states[t])
            put(free, remembered)
            for slot in range(scratch.followed.shape[0]):
                put(scratch_free.followed[slot], scratch.followed[slot])
            predicted[t, :] = np.nan
        else:
            read_with(
                read, measures, extension, scratch_free, t, x, inputs[t], free, parameters,
                expected,
            )  # fmt: skip
            put(predicted[t], expected)
        _advance(
            drive, step, remember, measures, extension, scratch_free, t, x, ahead, inputs[t],
            free, parameters,
        )  # fmt: skip
        put(x, ahead)
        _advance(
            drive, step, remember, measures, extension, scratch, t, states[t], ahead,
            inputs[t], remembered, parameters,
        )  # fmt: skip


@njit(_FREE, cache=True, error_model="numpy", nogil=True)
def run_free(drive, step, remember, read, measures, inputs, readings, begun, steering, simulated):
    """Simulate a plant along a recording; its inputs are changed to keep it on the recorded course.

    Args:
        drive: as in `run_filter`.
        step: as in `run_filter`.
        remember: as in `run_filter`.
        read: as in `run_filter`.
        measures: as in `run_filter`.
        inputs: float64 (n, inputs), as recorded; changed in place to those that were applied.
        readings: float64 (n, outputs), as recorded.
        begun: the plant at the first sample; its memory is changed.
        steering: float64 (inputs, outputs), what is added to an input for each unit by which a
            simulated reading is below the recorded one; all 0 for a free run.
        simulated: float64 (n, outputs), written: readings without noise.
    """
    parameters, remembered = begun.parameters, begun.memory[0]
    x, ahead = begun.start.copy(), np.empty(begun.start.size)
    extension, scratch = begun.extension, scratch_of(parameters, begun.extension)
    expected = np.empty(readings.shape[1])
    for t in range(inputs.shape[0]):
        read_with(
            read, measures, extension, scratch, t, x, inputs[t], remembered, parameters, expected
        )
        put(simulated[t], expected)
        for j in range(inputs.shape[1]):
            value = inputs[t, j]
            for i in range(expected.size):
                value += steering[j, i] * (readings[t, i] - expected[i])
            inputs[t, j] = value
        _advance(
            drive, step, remember, measures, extension, scratch, t, x, ahead, inputs[t],
            remembered, parameters,
        )  # fmt: skip
        put(x, ahead)
