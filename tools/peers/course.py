"""The course of a recording as a model sees it: filtered states, disturbances, and predictions.

The gains of the filter are the product's (`Predictor.filter`). What the product has not is here:
the disturbances that a smoother finds in the states, and predictions of a model whose states get a
correction in each sample.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numba import float64, types, void
from numpy.typing import NDArray

from estimator.gap.plant import DRIVE, READ, REMEMBER, STEP, Array, Plant, Record, roughness
from estimator.gap.prediction.linear import SETTLING_S
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.with_additions import put
from rig.jit import njit

Values = Mapping[str, float]
Kicks = Callable[[Array, Array, Array], Array]
"""A correction: (states (n, k), inputs (n, i), time since the recording began (n,), s) -> what is
added to the states by the next sample, (n, k)."""

_PLANT: Final = tuple(types.FunctionType(kind) for kind in (DRIVE, STEP, REMEMBER, READ))
_VECTOR: Final = float64[::1]
_MATRIX: Final = float64[:, ::1]
_CUBE: Final = float64[:, :, ::1]
_FIRST: Final = 20
_ROUNDS: Final = 3
"""Filter runs in which a correction is taken along the course of the run before. The courses of the
second and third differ by less than the noise of a reading."""


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _VECTOR, _MATRIX, _VECTOR, _CUBE, _CUBE),
    cache=True, error_model="numpy",
)  # fmt: skip
def _linearise(
    drive, step, remember, read, inputs, states, parameters, memory, changes, ahead_of, read_of
):
    """Write the derivatives of the next state and of the readings by each filtered state."""
    count, outputs = states.shape[1], read_of.shape[1]
    remembered = memory[0]
    ahead, moved = np.empty(count), np.empty(count)
    expected, shifted = np.empty(outputs), np.empty(outputs)
    for t in range(states.shape[0]):
        read(states[t], remembered, parameters, expected)
        for j in range(count):
            put(moved, states[t])
            moved[j] += changes[j]
            read(moved, remembered, parameters, shifted)
            for i in range(outputs):
                read_of[t, i, j] = (shifted[i] - expected[i]) / changes[j]
        drive(inputs[t], remembered, parameters)
        put(ahead, states[t])
        step(ahead, remembered, parameters)
        for j in range(count):
            put(moved, states[t])
            moved[j] += changes[j]
            step(moved, remembered, parameters)
            for i in range(count):
                ahead_of[t, i, j] = (moved[i] - ahead[i]) / changes[j]
        # A step changes the memory: the last must be that of the course.
        put(ahead, states[t])
        step(ahead, remembered, parameters)
        remember(states[t], ahead, remembered, parameters)


@njit(
    void(_CUBE, _CUBE, _CUBE, _MATRIX, _MATRIX, _VECTOR, _MATRIX),
    cache=True, error_model="numpy",
)  # fmt: skip
def _smooth(ahead_of, read_of, gains, variances, innovations, noises, found):
    """Write the smoothed disturbance of each state from each sample to the next.

    It is that of a fixed-interval smoother in the form of Bryson and Frazier (1963): the adjoint of
    the filter is run backwards over the innovations (SI), and `noises`, the variances of the
    states' errors over a sample, turn it into disturbances.
    """
    samples, outputs, count = read_of.shape
    adjoint, before = np.zeros(count), np.empty(count)
    found[:] = 0.0
    for t in range(samples - 1, -1, -1):
        for i in range(outputs - 1, -1, -1):
            if variances[t, i] < np.inf:
                size = innovations[t, i] / variances[t, i]
                for j in range(count):
                    size -= gains[t, i, j] * adjoint[j]
                for j in range(count):
                    adjoint[j] += read_of[t, i, j] * size
        if t == 0:
            break
        for j in range(count):
            found[t - 1, j] = noises[j] * adjoint[j]
        for j in range(count):
            before[j] = 0.0
            for k in range(count):
                before[j] += ahead_of[t - 1, k, j] * adjoint[k]
        put(adjoint, before)


@njit(
    void(*_PLANT, _MATRIX, _MATRIX, _CUBE, _MATRIX, _CUBE, _VECTOR, _VECTOR, _MATRIX, _MATRIX,
         _MATRIX, _MATRIX),
    cache=True, error_model="numpy",
)  # fmt: skip
def _filter(
    drive, step, remember, read, inputs, readings, gains, variances, couplings, parameters, start,
    memory, kicks, states, memories,
):  # fmt: skip
    """Filter readings with given gains, with `kicks` added to the states from sample to sample.

    The filtered states (n, k) and the memory before each sample's step (n, length) are written.
    """
    count, outputs = start.size, readings.shape[1]
    remembered = memory[0]
    x, expected = start.copy(), np.empty(outputs)
    for t in range(inputs.shape[0]):
        put(memories[t], remembered)
        read(x, remembered, parameters, expected)
        for i in range(outputs):
            if not variances[t, i] < np.inf:
                expected[i] = 0.0
                continue
            innovation = readings[t, i] - expected[i]
            for k in range(i):
                innovation -= couplings[t, i, k] * expected[k]
            expected[i] = innovation
            for j in range(count):
                x[j] += gains[t, i, j] * innovation
        put(states[t], x)
        drive(inputs[t], remembered, parameters)
        step(x, remembered, parameters)
        for j in range(count):
            x[j] += kicks[t, j]
        remember(states[t], x, remembered, parameters)


@njit(
    void(*_PLANT, _MATRIX, _VECTOR, _MATRIX, _MATRIX, _MATRIX, _MATRIX),
    cache=True, error_model="numpy",
)  # fmt: skip
def _advance(drive, step, remember, read, inputs, parameters, kicks, states, memories, readings):
    """Advance states (w, k) and memories (w, length) by a sample; write the readings (w, o)."""
    before = np.empty(states.shape[1])
    for w in range(states.shape[0]):
        put(before, states[w])
        drive(inputs[w], memories[w], parameters)
        step(states[w], memories[w], parameters)
        for j in range(states.shape[1]):
            states[w, j] += kicks[w, j]
        remember(before, states[w], memories[w], parameters)
        read(states[w], memories[w], parameters, readings[w])


@dataclass(frozen=True, eq=False)
class Predictions:
    """What a model predicts of a record over the plant's horizon.

    Attributes:
        errors: float64 (n, outputs), readings less predictions, SI; NaN at the starts, and where a
            reading is not used.
        states: float64 (n, states), filtered.
    """

    errors: Array
    states: Array


class Course:
    """One record, filtered with one model.

    Args:
        plant: the plant; its states' noise is that of the filter.
        record: the record.
        values: values of all parameters, SI.

    Attributes:
        states: float64 (n, states), filtered.
        time_s: float64 (n,), since the recording began.
    """

    def __init__(self, plant: Plant, record: Record, values: Values) -> None:
        self.plant, self.record, self.values = plant, record, values
        predictor = Predictor(plant)
        self._gains = predictor.filter(record, values)
        scaled, self.states = predictor.innovations(record, self._gains, values)
        used = np.isfinite(self._gains.variances)
        self._innovations = np.zeros_like(scaled)
        self._innovations[used] = scaled[used] * np.sqrt(self._gains.variances[used])
        self._functions = (plant.drive, plant.step, plant.remember, plant.read)
        self._parameters = plant.vector(values)
        self._first = np.where(
            np.isfinite(record.variances[:_FIRST]), record.readings[:_FIRST], np.nan
        )
        self._first[0] = record.readings[0]
        self.time_s: Array = (
            record.first + np.arange(len(record), dtype=np.float64)
        ) * plant.period

    def _begun(self) -> tuple[Array, Array]:
        inputs = self.record.inputs[:_FIRST]
        start = self.plant.start(self._first, inputs, self.values)[0]
        time_s = self.record.first * self.plant.period
        return start, self.plant.begin(start, inputs, self.values, time_s)[None, :].copy()

    @property
    def settled(self) -> NDArray[np.bool_]:
        """Return for each sample, bool (n,), whether the filter is settled and the plant calm."""
        calm = roughness(self.record, self.plant, self.values).max(axis=1) == 0.0
        calm[: round(SETTLING_S / self.plant.period)] = False
        return calm

    @cached_property
    def disturbances(self) -> Array:
        """By how much each state was off what the model says, per sample, (n, states), SI.

        Entry t is what has to be added between samples t and t + 1, by a smoother to which the
        whole record is known. States without noise have none.
        """
        plant, count = self.plant, len(self.plant.states)
        samples, outputs = self.record.readings.shape
        changes = np.array([state.change for state in plant.states])
        ahead_of, read_of = (
            np.empty((samples, count, count)), np.empty((samples, outputs, count))
        )  # fmt: skip
        _linearise(
            *self._functions, self.record.inputs, self.states, self._parameters,
            self._begun()[1], changes, ahead_of, read_of,
        )  # fmt: skip
        noises = np.array([state.noise for state in plant.states]) ** 2
        found = np.empty((samples, count))
        _smooth(
            ahead_of, read_of, self._gains.states, self._gains.variances, self._innovations, noises,
            found,
        )  # fmt: skip
        return found

    def predictions(self, kicks: Kicks | None = None) -> Predictions:
        """Return the predictions over the plant's horizon, with a correction or without.

        With a correction both the filter and the predictions have it. The filter keeps the gains
        that it has without. Predictions begin as those of `Predictor.ahead` do.
        """
        record, count = self.record, len(self.plant.states)
        states, memories = self.states, np.empty((len(record), self._begun()[1].shape[1]))
        for _ in range(_ROUNDS if kicks is not None else 1):
            added = np.zeros((len(record), count))
            if kicks is not None:
                added = np.ascontiguousarray(kicks(states, record.inputs, self.time_s))
            start, memory = self._begun()
            states = np.empty((len(record), count))
            _filter(
                *self._functions, record.inputs, record.readings, self._gains.states,
                self._gains.variances, self._gains.couplings, self._parameters, start, memory,
                added, states, memories,
            )  # fmt: skip
        return Predictions(self._ahead(states, memories, kicks), states)

    def _ahead(self, states: Array, memories: Array, kicks: Kicks | None) -> Array:
        record = self.record
        horizon = round(self.plant.horizon / self.plant.period)
        predicted = np.full_like(record.readings, np.nan)
        at = np.arange(0, len(record), horizon)
        x, memory = states[at].copy(), memories[at].copy()
        for _ in range(horizon - 1):
            kept = at + 1 < len(record)
            at, x, memory = at[kept], x[kept].copy(), memory[kept].copy()
            inputs = np.ascontiguousarray(record.inputs[at])
            added = np.zeros_like(x)
            if kicks is not None:
                added = np.ascontiguousarray(kicks(x, inputs, self.time_s[at]))
            readings = np.empty((len(at), record.readings.shape[1]))
            _advance(*self._functions, inputs, self._parameters, added, x, memory, readings)
            at = at + 1
            predicted[at] = readings
        errors = record.readings - predicted
        errors[~np.isfinite(record.variances)] = np.nan
        return np.asarray(errors)


def squared_errors(courses: list[Course], kicks: Kicks | None = None) -> Array:
    """Return the mean squared errors over the horizon (outputs,), in noise variances of a reading.

    They are means over the records, weighted by length, without the filter's settling, as in the
    product's own gap. A prediction that is not finite makes them infinite.
    """
    plant = courses[0].plant
    variances = np.array([output.variance for output in plant.outputs])
    settled = slice(round(SETTLING_S / plant.period), None)
    total, weights = np.zeros(len(variances)), np.zeros(len(variances))
    for course in courses:
        with np.errstate(all="ignore"):
            made = course.predictions(kicks)
            if not np.isfinite(made.states).all():
                return np.full(len(variances), np.inf)
            errors = made.errors[settled]
            due = np.isfinite(course.record.variances[settled])
            due[_starts(course)[settled]] = False
            squares = np.where(due, np.square(errors), 0.0).sum(0) / np.maximum(due.sum(0), 1)
        squares[~np.isfinite(squares)] = np.inf
        known = due.any(axis=0) * float(len(course.record))
        total += np.where(known > 0.0, squares, 0.0) * known
        weights += known
    return np.asarray(total / np.maximum(weights, 1.0) / variances)


def _starts(course: Course) -> NDArray[np.bool_]:
    horizon = round(course.plant.horizon / course.plant.period)
    return np.asarray(np.arange(len(course.record)) % horizon == 0)
