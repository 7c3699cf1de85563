"""Predicts a recording one sample ahead by an extended Kalman filter of any plant, compiled.

A first run estimates how strongly each measurement corrects each state (`run_filter`). Further runs
keep these gains (`run_frozen`): they predict as functions of the parameters alone, at a fiftieth of
the cost, which is what fits and derivatives by parameters are made with (prediction-error method,
Ljung 1999, ch. 7).
"""

from math import sqrt
from typing import Final

import numpy as np
from numba import float64, int64, njit, types, void

from estimator.gap.plant import DRIVE, READ, REMEMBER, STEP
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


@njit(cache=True, error_model="numpy", forceinline=True)
def _advance(drive, step, remember, before, x, inputs, memory, parameters):
    """Move a state (count,) and its memory (length,) by a sample of inputs, from before to x."""
    put(x, before)
    drive(inputs, memory, parameters)
    step(x, memory, parameters)
    remember(before, x, memory, parameters)


@inner
def correct(
    read, memory, parameters, changes, shares, readings, variances, x, covariance, slope, gains,
    innovation_variances, couplings,
):  # fmt: skip
    """Correct a state and its covariance in place by the readings of one sample.

    They are taken one after the other (Bierman 1977, ch. 2), each linearised about the prediction;
    the covariance is that of the gains used, whatever part of the best ones (Joseph's form).

    Args:
        read: of the plant, compiled with READ.
        memory: float64 (length,).
        parameters: of the plant.
        changes: float64 (states,), for derivatives by differences.
        shares: float64 (outputs, states), part of the best gains that is used.
        readings: float64 (outputs,).
        variances: float64 (outputs,), of the readings; infinite where one is not to be used.
        x: float64 (states,), predicted; updated.
        covariance: float64 (states, states); updated.
        slope: float64 (outputs, states), written: derivatives of the readings.
        gains: float64 (outputs, states), written, as all that follow as of `run_filter`.
        innovation_variances: float64 (outputs,), written.
        couplings: float64 (outputs, outputs), written.
    """
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


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR,
         _MATRIX, _MATRIX, _CUBE, _MATRIX, _CUBE),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_filter(
    drive, step, remember, read, inputs, readings, variances, parameters, start, spread, changes,
    noises, shares, memory, gains, innovation_variances, couplings,
):  # fmt: skip
    """Run the filter over a recording and keep its gains.

    Args:
        drive: of the plant, compiled with DRIVE.
        step: of the plant, compiled with STEP.
        remember: of the plant, compiled with REMEMBER.
        read: of the plant, compiled with READ.
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        variances: float64 (n, outputs), of the readings; infinite where one is not to be used.
        parameters: of the plant.
        start: float64 (states,).
        spread: float64 (states,), standard deviations of `start`.
        changes: float64 (states,), for derivatives by differences.
        noises: float64 (states,), variances of the model's error over one sample.
        shares: float64 (outputs, states), part of the best gains that is used.
        memory: float64 (1, length), of `Plant.begin`.
        gains: float64 (n, outputs, states), written.
        innovation_variances: float64 (n, outputs), written; infinite where not used.
        couplings: float64 (n, outputs, outputs), written: how much of an innovation is in that of
            a later reading of the sample, before the state is corrected by it.
    """
    count, outputs = start.size, readings.shape[1]
    remembered = memory[0]
    x = start.copy()
    point, ahead = np.empty(count), np.empty(count)
    covariance = np.diag(spread * spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slope = np.empty((outputs, count))
    for t in range(inputs.shape[0]):
        correct(
            read, remembered, parameters, changes, shares, readings[t], variances[t], x, covariance,
            slope, gains[t], innovation_variances[t], couplings[t],
        )  # fmt: skip
        drive(inputs[t], remembered, parameters)
        put(ahead, x)
        step(ahead, remembered, parameters)
        for j in range(count):
            put(point, x)
            point[j] += changes[j]
            step(point, remembered, parameters)
            for i in range(count):
                transition[i, j] = (point[i] - ahead[i]) / changes[j]
        predict_covariance(transition, noises, product, covariance)
        remember(x, ahead, remembered, parameters)
        put(x, ahead)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _MATRIX, _CUBE, _CUBE, _VECTOR, _VECTOR, _MATRIX, _MATRIX,
         _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_frozen(
    drive, step, remember, read, inputs, readings, innovation_variances, gains, couplings,
    parameters, start, memory, innovations, states,
):  # fmt: skip
    """Predict a recording one sample ahead with given gains.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        innovation_variances: float64 (n, outputs), of `run_filter`.
        gains: float64 (n, outputs, states), of `run_filter`.
        couplings: float64 (n, outputs, outputs), of `run_filter`.
        parameters: of the plant.
        start: float64 (states,).
        memory: float64 (1, length), of `Plant.begin`.
        innovations: float64 (n, outputs), written: over their standard deviations, 0 if not used.
        states: float64 (n, states), written: filtered.
    """
    count, outputs = start.size, readings.shape[1]
    remembered = memory[0]
    x = start.copy()
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
    void(*_PLANT, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _MATRIX, _MATRIX, int64, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def predict_ahead(
    drive, step, remember, read, inputs, readings, states, parameters, memory, memories, horizon,
    errors,
):  # fmt: skip
    """Predict from each `horizon`-th filtered state to the next, and write the errors.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        states: float64 (n, states), filtered, of `run_frozen`.
        parameters: of the plant.
        memory: float64 (1, length), of `Plant.begin`.
        memories: float64 (1, length), scratch.
        horizon: samples.
        errors: float64 (n, outputs), written: readings less predictions; NaN at the starts.
    """
    count, outputs = states.shape[1], readings.shape[1]
    remembered, free = memory[0], memories[0]
    x, expected = np.empty(count), np.empty(outputs)
    ahead = np.empty(count)
    for t in range(inputs.shape[0]):
        if t % horizon == 0:
            put(x, states[t])
            put(free, remembered)
            errors[t, :] = np.nan
        else:
            read(x, free, parameters, expected)
            for i in range(outputs):
                errors[t, i] = readings[t, i] - expected[i]
        _advance(drive, step, remember, x, ahead, inputs[t], free, parameters)
        put(x, ahead)
        _advance(drive, step, remember, states[t], ahead, inputs[t], remembered, parameters)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _MATRIX, _MATRIX, _MATRIX, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_free(
    drive, step, remember, read, inputs, readings, parameters, start, memory, steering, driven,
    simulated,
):  # fmt: skip
    """Simulate a plant that follows a recording: inputs are changed to keep it on its course.

    Args:
        drive: as of `run_filter`.
        step: likewise.
        remember: likewise.
        read: likewise.
        inputs: float64 (n, inputs).
        readings: float64 (n, outputs).
        parameters: of the plant.
        start: float64 (states,).
        memory: float64 (1, length), of `Plant.begin`.
        steering: float64 (inputs, outputs): what is added to an input for one unit by which a
            simulated reading is below the recorded one; zeros for a free run.
        driven: float64 (n, inputs), written: the inputs applied.
        simulated: float64 (n, outputs), written: readings without noise.
    """
    remembered = memory[0]
    x, ahead = start.copy(), np.empty(start.size)
    expected = np.empty(readings.shape[1])
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        put(simulated[t], expected)
        for j in range(inputs.shape[1]):
            value = inputs[t, j]
            for i in range(expected.size):
                value += steering[j, i] * (readings[t, i] - expected[i])
            driven[t, j] = value
        _advance(drive, step, remember, x, ahead, driven[t], remembered, parameters)
        put(x, ahead)
