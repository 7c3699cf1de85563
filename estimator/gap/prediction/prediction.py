"""Predicts a recording one sample ahead by an extended Kalman filter of any plant, compiled.

A first run estimates how strongly each measurement corrects each state (`run_filter`). Further runs
keep these gains (`run_frozen`): they predict as functions of the parameters alone, at a fiftieth of
the cost, which is what fits and derivatives by parameters are made with (prediction-error method,
Ljung 1999, ch. 7).
"""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import float64, int64, types, void

from estimator.gap.plant import DRIVE, READ, REMEMBER, STEP, Array
from rig.jit import njit
from rig.plant import inlined, inner

_DRIVE: Final = types.FunctionType(DRIVE)
_STEP: Final = types.FunctionType(STEP)
_REMEMBER: Final = types.FunctionType(REMEMBER)
_READ: Final = types.FunctionType(READ)
_PLANT: Final = (_DRIVE, _STEP, _REMEMBER, _READ)

_VECTOR: Final = float64[::1]
_MATRIX: Final = float64[:, ::1]
_CUBE: Final = float64[:, :, ::1]


@inlined
def put(target, values):
    """Write values (count,) to a target of the same length.

    A slice would do the same, and have the compiler make words of the two lengths, in case they
    differ: that takes two seconds in each process that compiles.
    """
    for i in range(target.size):
        target[i] = values[i]


class Track(NamedTuple):
    """A record, and the gains of a filter along it.

    Attributes:
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        gains: float64 (n, outputs, states).
        variances: float64 (n, outputs), of the innovations; infinite where not used.
        couplings: float64 (n, outputs, outputs), how much of an innovation is in that of a later
            reading of the sample, before the state is corrected by it.
    """

    inputs: Array
    readings: Array
    gains: Array
    variances: Array
    couplings: Array


class Setup(NamedTuple):
    """What a filter goes by, besides the record.

    Attributes:
        variances: float64 (n, outputs), of the readings; infinite where one is not to be used.
        parameters: float64 (parameters,), of the plant.
        start: float64 (states,).
        spread: float64 (states,), standard deviations of `start`.
        changes: float64 (states,), for derivatives by differences.
        noises: float64 (states,), variances of the model's error over one sample.
        shares: float64 (outputs, states), part of the best gains that is used.
        memory: float64 (1, length), of `Plant.begin`; changed by a run.
    """

    variances: Array
    parameters: Array
    start: Array
    spread: Array
    changes: Array
    noises: Array
    shares: Array
    memory: Array


class Begun(NamedTuple):
    """A plant at the first sample of a record; in lanes, each array has an axis LANES more.

    Attributes:
        parameters: float64 (parameters,).
        start: float64 (states,).
        memory: float64 (1, length), of `Plant.begin`, in lanes (rows, LANES), of `InLanes.begin`;
            changed by a run.
    """

    parameters: Array
    start: Array
    memory: Array


TRACK: Final = types.BaseTuple.from_types((_MATRIX, _MATRIX, _CUBE, _MATRIX, _CUBE), Track)
SETUP: Final = types.BaseTuple.from_types(
    (_MATRIX, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _MATRIX, _MATRIX), Setup
)
_BEGUN: Final = types.BaseTuple.from_types((_VECTOR, _VECTOR, _MATRIX), Begun)


@njit(cache=True, error_model="numpy", forceinline=True)
def _advance(drive, step, remember, before, x, inputs, memory, parameters):
    """Move a state (count,) and its memory (length,) by a sample of inputs, from before to x."""
    put(x, before)
    drive(inputs, memory, parameters)
    step(x, memory, parameters)
    remember(before, x, memory, parameters)


@inner
def correct(read, memory, setup, track, t, x, covariance, slope):
    """Correct a state and its covariance in place by the readings of one sample; keep its gains.

    They are taken one after the other (Bierman 1977, ch. 2), each linearised about the prediction;
    the covariance is that of the gains used, whatever part of the best ones (Joseph's form).

    Args:
        read: of the plant, compiled with READ.
        memory: float64 (length,).
        setup: of the filter.
        track: of the record; the sample's gains are written.
        t: the sample.
        x: float64 (states,), predicted; updated.
        covariance: float64 (states, states); updated.
        slope: float64 (outputs, states), written: derivatives of the readings.
    """
    parameters, changes, shares = setup.parameters, setup.changes, setup.shares
    readings, variances = track.readings[t], setup.variances[t]
    gains, innovation_variances = track.gains[t], track.variances[t]
    couplings = track.couplings[t]
    count, outputs = x.size, readings.size
    expected, shifted = np.empty(outputs), np.empty(outputs)
    ahead = np.empty(count)
    point = x.copy()
    read(x, memory, parameters, expected)
    for j in range(count):
        point[j] = x[j] + changes[j]
        read(point, memory, parameters, shifted)
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
        for j in range(count):
            innovation -= slope[i, j] * (x[j] - point[j])
            total = 0.0
            for k in range(count):
                # Most readings are of one state alone.
                if slope[i, k] != 0.0:
                    total += covariance[j, k] * slope[i, k]
            ahead[j] = total
            variance += slope[i, j] * total
        innovation_variances[i] = variance
        for k in range(i):
            for j in range(count):
                couplings[i, k] += slope[i, j] * gains[k, j]
        whole = True
        for j in range(count):
            gains[i, j] = ahead[j] / variance
            if shares[i, j] != 1.0:
                gains[i, j] *= shares[i, j]
                whole = False
            x[j] += gains[i, j] * innovation
        for j in range(count):
            for k in range(count):
                covariance[j, k] -= gains[i, j] * ahead[k]
                if not whole:
                    covariance[j, k] -= (ahead[j] - gains[i, j] * variance) * gains[i, k]


@inner
def predict_covariance(transition, noises, product, covariance):
    """Move a covariance (states, states) in place by a step of its transition.

    Args:
        transition: float64 (states, states), of the state by that before.
        noises: float64 (states,), variances of the model's error over one sample.
        product: float64 (states, states), scratch.
        covariance: updated.
    """
    count = noises.size
    # Along rows, so that the processor adds several at once.
    for i in range(count):
        for j in range(count):
            product[i, j] = 0.0
        for k in range(count):
            rate = transition[i, k]
            for j in range(count):
                product[i, j] += rate * covariance[k, j]
    turned = transition.T.copy()
    for i in range(count):
        for j in range(count):
            covariance[i, j] = 0.0
        for k in range(count):
            part = product[i, k]
            for j in range(i + 1):
                covariance[i, j] += part * turned[k, j]
    for i in range(count):
        for j in range(i):
            covariance[j, i] = covariance[i, j]
        covariance[i, i] += noises[i]


@njit(void(*_PLANT, TRACK, SETUP), cache=True, error_model="numpy", nogil=True)
def run_filter(drive, step, remember, read, track, setup):
    """Run the filter over a recording and keep its gains.

    Args:
        drive: of the plant, compiled with DRIVE.
        step: of the plant, compiled with STEP.
        remember: of the plant, compiled with REMEMBER.
        read: of the plant, compiled with READ.
        track: of the record; its gains are written.
        setup: of the filter.
    """
    inputs, outputs = track.inputs, track.readings.shape[1]
    parameters, changes, count = setup.parameters, setup.changes, setup.start.size
    remembered = setup.memory[0]
    x = setup.start.copy()
    point, ahead = np.empty(count), np.empty(count)
    covariance = np.diag(setup.spread * setup.spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slope = np.empty((outputs, count))
    for t in range(inputs.shape[0]):
        correct(read, remembered, setup, track, t, x, covariance, slope)
        drive(inputs[t], remembered, parameters)
        put(ahead, x)
        step(ahead, remembered, parameters)
        for j in range(count):
            put(point, x)
            point[j] += changes[j]
            step(point, remembered, parameters)
            for i in range(count):
                transition[i, j] = (point[i] - ahead[i]) / changes[j]
        predict_covariance(transition, setup.noises, product, covariance)
        remember(x, ahead, remembered, parameters)
        put(x, ahead)


@njit(void(*_PLANT, TRACK, _BEGUN, _MATRIX, _MATRIX), cache=True, error_model="numpy", nogil=True)
def run_frozen(drive, step, remember, read, track, begun, innovations, states):
    """Predict a recording one sample ahead with given gains.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        track: of the record.
        begun: the plant at its first sample.
        innovations: float64 (n, outputs), written: over their standard deviations, 0 if not used.
        states: float64 (n, states), written: filtered.
    """
    inputs, readings, parameters = track.inputs, track.readings, begun.parameters
    gains, innovation_variances, couplings = track.gains, track.variances, track.couplings
    count, outputs = begun.start.size, readings.shape[1]
    remembered = begun.memory[0]
    x = begun.start.copy()
    expected = np.empty(outputs)
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        for i in range(outputs):
            variance = innovation_variances[t, i]
            if not variance < np.inf:
                innovations[t, i] = 0.0
                expected[i] = 0.0
                continue
            innovation = readings[t, i] - expected[i]
            # What the sample's other readings have corrected already, to first order.
            for k in range(i):
                innovation -= couplings[t, i, k] * expected[k]
            expected[i] = innovation
            innovations[t, i] = innovation / sqrt(variance)
            for j in range(count):
                x[j] += gains[t, i, j] * innovation
        for j in range(count):
            states[t, j] = x[j]
        drive(inputs[t], remembered, parameters)
        step(x, remembered, parameters)
        remember(states[t], x, remembered, parameters)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _BEGUN, int64, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def predict_ahead(drive, step, remember, read, inputs, states, begun, horizon, predicted):
    """Predict readings from each `horizon`-th filtered state to the next.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        inputs: float64 (n, inputs).
        states: float64 (n, states), filtered, of `run_frozen`.
        begun: the plant in the first of them.
        horizon: samples.
        predicted: float64 (n, outputs), written; NaN at the starts.
    """
    parameters, remembered = begun.parameters, begun.memory[0]
    free = remembered.copy()
    x, expected = begun.start.copy(), np.empty(predicted.shape[1])
    ahead = np.empty(x.size)
    for t in range(inputs.shape[0]):
        if t % horizon == 0:
            put(x, states[t])
            put(free, remembered)
            predicted[t, :] = np.nan
        else:
            read(x, free, parameters, expected)
            put(predicted[t], expected)
        _advance(drive, step, remember, x, ahead, inputs[t], free, parameters)
        put(x, ahead)
        _advance(drive, step, remember, states[t], ahead, inputs[t], remembered, parameters)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _BEGUN, _MATRIX, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_free(drive, step, remember, read, inputs, readings, begun, steering, simulated):
    """Simulate a plant that follows a recording: inputs are changed to keep it on its course.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        inputs: float64 (n, inputs), recorded; changed to those applied.
        readings: float64 (n, outputs).
        begun: the plant at the first sample.
        steering: float64 (inputs, outputs): what is added to an input for one unit by which a
            simulated reading is below the recorded one; zeros for a free run.
        simulated: float64 (n, outputs), written: readings without noise.
    """
    parameters, remembered = begun.parameters, begun.memory[0]
    x, ahead = begun.start.copy(), np.empty(begun.start.size)
    expected = np.empty(readings.shape[1])
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        put(simulated[t], expected)
        for j in range(inputs.shape[1]):
            value = inputs[t, j]
            for i in range(expected.size):
                value += steering[j, i] * (readings[t, i] - expected[i])
            inputs[t, j] = value
        _advance(drive, step, remember, x, ahead, inputs[t], remembered, parameters)
        put(x, ahead)
