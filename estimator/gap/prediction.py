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

from .plant import DRIVE, READ, REMEMBER, STEP

_DRIVE: Final = types.FunctionType(DRIVE)
_STEP: Final = types.FunctionType(STEP)
_REMEMBER: Final = types.FunctionType(REMEMBER)
_READ: Final = types.FunctionType(READ)
_PLANT: Final = (_DRIVE, _STEP, _REMEMBER, _READ)

_VECTOR: Final = float64[::1]
_MATRIX: Final = float64[:, ::1]
_CUBE: Final = float64[:, :, ::1]


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _MATRIX, _VECTOR, _VECTOR, _VECTOR, _VECTOR, _VECTOR,
         _MATRIX, _CUBE, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_filter(
    drive, step, remember, read, inputs, readings, variances, parameters, start, spread, changes,
    noises, memory, gains, innovation_variances,
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
        memory: float64 (1, length), zeros.
        gains: float64 (n, outputs, states), written.
        innovation_variances: float64 (n, outputs), written; infinite where not used.
    """
    count, outputs = start.size, readings.shape[1]
    remembered = memory[0]
    x = start.copy()
    point, ahead = np.empty(count), np.empty(count)
    expected, shifted = np.empty(outputs), np.empty(outputs)
    covariance = np.diag(spread * spread)
    transition, product = np.empty((count, count)), np.empty((count, count))
    slopes = np.empty((outputs, count))
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        for j in range(count):
            point[:] = x
            point[j] += changes[j]
            read(point, remembered, parameters, shifted)
            for i in range(outputs):
                slopes[i, j] = (shifted[i] - expected[i]) / changes[j]
        point[:] = x
        for i in range(outputs):
            variance = variances[t, i]
            if not variance < np.inf:
                innovation_variances[t, i] = np.inf
                gains[t, i, :] = 0.0
                continue
            innovation = readings[t, i] - expected[i]
            for j in range(count):
                innovation -= slopes[i, j] * (x[j] - point[j])
                total = 0.0
                for k in range(count):
                    total += covariance[j, k] * slopes[i, k]
                ahead[j] = total
                variance += slopes[i, j] * total
            innovation_variances[t, i] = variance
            for j in range(count):
                gains[t, i, j] = ahead[j] / variance
                x[j] += gains[t, i, j] * innovation
            for j in range(count):
                for k in range(count):
                    covariance[j, k] -= gains[t, i, j] * ahead[k]
        drive(inputs[t], remembered, parameters)
        ahead[:] = x
        step(ahead, remembered, parameters)
        for j in range(count):
            point[:] = x
            point[j] += changes[j]
            step(point, remembered, parameters)
            for i in range(count):
                transition[i, j] = (point[i] - ahead[i]) / changes[j]
        for i in range(count):
            for j in range(count):
                total = 0.0
                for k in range(count):
                    total += transition[i, k] * covariance[k, j]
                product[i, j] = total
        for i in range(count):
            for j in range(i + 1):
                total = 0.0
                for k in range(count):
                    total += product[i, k] * transition[j, k]
                covariance[i, j] = total
                covariance[j, i] = total
            covariance[i, i] += noises[i]
        x[:] = ahead
        remember(x, remembered, parameters)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _MATRIX, _CUBE, _VECTOR, _VECTOR, _MATRIX, _MATRIX, _VECTOR,
         _MATRIX, _MATRIX),
    cache=True, error_model="numpy", nogil=True,
)  # fmt: skip
def run_frozen(
    drive, step, remember, read, inputs, readings, innovation_variances, gains, parameters, start,
    memory, kicks, changes, innovations, states,
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
        parameters: of the plant.
        start: float64 (states,).
        memory: float64 (1, length), zeros.
        kicks: float64 (n, states) added to the state after each step; (0, states) for none.
        changes: float64 (states,), for derivatives by differences.
        innovations: float64 (n, outputs), written: over their standard deviations, 0 if not used.
        states: float64 (n, states), written: filtered.
    """
    count, outputs = start.size, readings.shape[1]
    remembered = memory[0]
    x = start.copy()
    before = np.empty(count)
    expected, shifted = np.empty(outputs), np.empty(outputs)
    kicked = kicks.shape[0] > 0
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        before[:] = x
        for i in range(outputs):
            variance = innovation_variances[t, i]
            if not variance < np.inf:
                innovations[t, i] = 0.0
                continue
            # What the sample's other readings have corrected already, to first order.
            if i > 0:
                read(x, remembered, parameters, shifted)
            else:
                shifted[i] = expected[i]
            innovation = readings[t, i] - shifted[i]
            innovations[t, i] = innovation / sqrt(variance)
            for j in range(count):
                x[j] += gains[t, i, j] * innovation
        states[t] = x
        drive(inputs[t], remembered, parameters)
        step(x, remembered, parameters)
        if kicked:
            for j in range(count):
                x[j] += kicks[t, j]
        remember(x, remembered, parameters)


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
        memory: float64 (1, length), zeros.
        memories: float64 (1, length), scratch.
        horizon: samples.
        errors: float64 (n, outputs), written: readings less predictions; NaN at the starts.
    """
    count, outputs = states.shape[1], readings.shape[1]
    remembered, free = memory[0], memories[0]
    x, expected = np.empty(count), np.empty(outputs)
    point = np.empty(count)
    for t in range(inputs.shape[0]):
        if t % horizon == 0:
            x[:] = states[t]
            free[:] = remembered
            errors[t, :] = np.nan
        else:
            read(x, free, parameters, expected)
            for i in range(outputs):
                errors[t, i] = readings[t, i] - expected[i]
        drive(inputs[t], free, parameters)
        step(x, free, parameters)
        remember(x, free, parameters)
        point[:] = states[t]
        drive(inputs[t], remembered, parameters)
        step(point, remembered, parameters)
        remember(point, remembered, parameters)


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
        memory: float64 (1, length), zeros.
        steering: float64 (inputs, outputs): what is added to an input for one unit by which a
            simulated reading is below the recorded one; zeros for a free run.
        driven: float64 (n, inputs), written: the inputs applied.
        simulated: float64 (n, outputs), written: readings without noise.
    """
    remembered = memory[0]
    x = start.copy()
    expected = np.empty(readings.shape[1])
    for t in range(inputs.shape[0]):
        read(x, remembered, parameters, expected)
        simulated[t] = expected
        for j in range(inputs.shape[1]):
            value = inputs[t, j]
            for i in range(expected.size):
                value += steering[j, i] * (readings[t, i] - expected[i])
            driven[t, j] = value
        drive(driven[t], remembered, parameters)
        step(x, remembered, parameters)
        remember(x, remembered, parameters)
