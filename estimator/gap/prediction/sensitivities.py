"""This module computes how innovations respond to kicks, which are changes of states and readings.

Along its filtered course the filter is a linear system that varies with time. Its matrices are
computed by differences, once for some stretches of a record (`linearise_course`). The response to
any disturbance is then a few products per sample (`respond`), a hundredth of the cost of a run of
the plant. What the sensors remember (a lag, a play) is left as it was: readings follow a kick of
the state at once.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import int64, void
from numpy.typing import NDArray

from estimator.gap.plant import Array, Gains, Record
from rig.jit import njit

from .prediction import ALONG, CUBE, MATRIX, PLANT, SLOPES, VECTOR, Along, Slopes
from .predictor import Predictor
from .variables import Values
from .with_additions import drive_with, put, read_with, remember_with, scratch_of, step_with

_LINEARISE: Final = void(*PLANT, ALONG, MATRIX, MATRIX, VECTOR, SLOPES)
_RESPOND: Final = void(CUBE, CUBE, CUBE, MATRIX, int64[::1], int64[::1], CUBE, MATRIX, CUBE)
_PULL_BACK: Final = void(CUBE, CUBE, CUBE, MATRIX, int64[::1], MATRIX, MATRIX)


@njit(_LINEARISE, cache=True, error_model="numpy", nogil=True)
def linearise_course(
    drive, step, remember, read, measures, along, parameters, memory, changes, written
):
    """Linearise the step and the readings of a plant at the wanted samples of a filtered course.

    Args:
        drive: function of the plant, compiled with DRIVE.
        step: function of the plant, compiled with STEP.
        remember: function of the plant, compiled with REMEMBER.
        read: function of the plant, compiled with READ.
        measures: function of the plant, compiled with MEASURE.
        along: the course.
        parameters: float64 (1 + probes, count), the present values of all parameters, then a row
            for each probe, with its changes.
        memory: float64 (1, length), at the first sample; changed.
        changes: float64 (k,), changes of the states by which derivatives are taken.
        written: the linearisation, which is written: derivatives by the states, and what each probe
            adds, which is not divided by the size of its change.
    """
    inputs, states, places = along.inputs, along.states, along.places
    transitions, slopes, shifts = written.transitions, written.slopes, written.shifts
    count, outputs = states.shape[1], slopes.shape[1]
    remembered, present = memory[0], parameters[0]
    point, ahead = np.empty(count), np.empty(count)
    expected, shifted = np.empty(outputs), np.empty(outputs)
    moved = np.empty(count)
    extension, scratch = along.extension, scratch_of(present, along.extension)
    for t in range(states.shape[0]):
        row, now = places[t], inputs[t]
        if row >= 0:
            read_with(
                read, measures, extension, scratch, t, states[t], now, remembered, present, expected
            )
            for j in range(count):
                put(point, states[t])
                point[j] += changes[j]
                read_with(
                    read, measures, extension, scratch, t, point, now, remembered, present, shifted
                )
                for i in range(outputs):
                    slopes[row, i, j] = (shifted[i] - expected[i]) / changes[j]
            for p in range(shifts.shape[2]):
                read_with(
                    read, measures, extension, scratch, t, states[t], now, remembered,
                    parameters[1 + p], shifted,
                )  # fmt: skip
                for i in range(outputs):
                    shifts[row, count + i, p] = shifted[i] - expected[i]
        drive_with(drive, measures, extension, scratch, t, states[t], now, remembered, present)
        step_with(step, measures, extension, scratch, t, states[t], ahead, now, remembered, present)
        if row >= 0:
            for j in range(count):
                put(moved, states[t])
                moved[j] += changes[j]
                step_with(
                    step, measures, extension, scratch, t, moved, point, now, remembered, present
                )
                for i in range(count):
                    transitions[row, i, j] = (point[i] - ahead[i]) / changes[j]
            for p in range(shifts.shape[2]):
                step_with(
                    step, measures, extension, scratch, t, states[t], point, now,
                    remembered, parameters[1 + p],
                )  # fmt: skip
                for i in range(count):
                    shifts[row, i, p] = point[i] - ahead[i]
            # Each step changes the memory, so that the last step must be that of the present
            # values.
            step_with(
                step, measures, extension, scratch, t, states[t], ahead, now, remembered, present
            )
        remember_with(
            remember, measures, extension, scratch, states[t], ahead, now, remembered, present
        )


@njit(_RESPOND, cache=True, error_model="numpy", nogil=True)
def respond(transitions, slopes, gains, variances, starts, rows, rates, shapes, answers):
    """Compute the changes of the innovations by kicks, divided by the standard deviations of these.

    Args:
        transitions: float64 (m, k, k), of `linearise_course`.
        slopes: float64 (m, outputs, k), of `linearise_course`.
        gains: float64 (m, outputs, k), of the filter.
        variances: float64 (m, outputs), of the innovations; infinite where a reading is not used.
        starts: int64 (m,), 1 where a stretch begins; no kick before it has an effect there.
        rows: int64 (r,), what is kicked: j for state j after the step, k + i for reading i.
        rates: float64 (m, r, 1) or (m, r, columns), kicks by a shape of one, SI; with one column,
            they are the same for all shapes.
        shapes: float64 (m, columns), by which the rates are multiplied.
        answers: float64 (m, outputs, columns), written: the changes; 0 where a reading is not used.
    """
    count, outputs, columns = transitions.shape[1], slopes.shape[1], shapes.shape[1]
    alike = rates.shape[2] == 1
    x, ahead = np.zeros((count, columns)), np.zeros((count, columns))
    error = np.empty(columns)
    for t in range(transitions.shape[0]):
        if starts[t] == 1:
            x[:] = 0.0
        for i in range(outputs):
            if not variances[t, i] < np.inf:
                answers[t, i, :] = 0.0
                continue
            error[:] = 0.0
            for j in range(count):
                slope = slopes[t, i, j]
                if slope != 0.0:
                    for c in range(columns):
                        error[c] -= slope * x[j, c]
            for r in range(rows.size):
                if rows[r] == count + i:
                    for c in range(columns):
                        error[c] -= rates[t, r, 0 if alike else c] * shapes[t, c]
            scale = 1.0 / np.sqrt(variances[t, i])
            for c in range(columns):
                answers[t, i, c] = scale * error[c]
            for j in range(count):
                gain = gains[t, i, j]
                for c in range(columns):
                    x[j, c] += gain * error[c]
        ahead[:] = 0.0
        for i in range(count):
            for j in range(count):
                slope = transitions[t, i, j]
                if slope != 0.0:
                    for c in range(columns):
                        ahead[i, c] += slope * x[j, c]
        for r in range(rows.size):
            if rows[r] < count and alike:
                rate = rates[t, r, 0]
                for c in range(columns):
                    ahead[rows[r], c] += rate * shapes[t, c]
            elif rows[r] < count:
                for c in range(columns):
                    ahead[rows[r], c] += rates[t, r, c] * shapes[t, c]
        for i in range(count):
            put(x[i], ahead[i])


@njit(_PULL_BACK, cache=True, error_model="numpy", nogil=True)
def pull_back(transitions, slopes, gains, variances, starts, weights, pulls):
    """Compute by how much each possible kick changes a weighted sum of what `respond` computes.

    This is the adjoint of `respond`: one run backwards in time gives the derivatives by all kicks.
    The arrays that are not described here are those of `respond`.

    Args:
        transitions: as in `respond`.
        slopes: as in `respond`.
        gains: as in `respond`.
        variances: as in `respond`.
        starts: as in `respond`.
        weights: float64 (m, outputs), weights of the changes in the sum.
        pulls: float64 (m, k + outputs), written: derivatives of the sum by a kick of each state
            after the step, then of each reading, per SI unit.
    """
    count, outputs = transitions.shape[1], slopes.shape[1]
    x, before = np.zeros(count), np.zeros(count)
    for t in range(transitions.shape[0] - 1, -1, -1):
        for j in range(count):
            pulls[t, j] = x[j]
        before[:] = 0.0
        for i in range(count):
            for j in range(count):
                before[j] += transitions[t, i, j] * x[i]
        put(x, before)
        for i in range(outputs - 1, -1, -1):
            pulls[t, count + i] = 0.0
            if not variances[t, i] < np.inf:
                continue
            error = weights[t, i] / np.sqrt(variances[t, i])
            for j in range(count):
                error += gains[t, i, j] * x[j]
            pulls[t, count + i] = -error
            for j in range(count):
                x[j] -= slopes[t, i, j] * error
        # No kick before the beginning of a stretch has an effect in it.
        if starts[t] == 1:
            x[:] = 0.0


@dataclass(frozen=True)
class Course:
    """Stretches of a record, with the model linearised along the filtered course in them.

    Attributes:
        samples: int64 (m,), indices of the samples in the record.
        innovations: float64 (m, outputs), divided by their standard deviations.
        states: float64 (m, k), filtered.
        inputs: float64 (m, inputs).
        transitions: float64 (m, k, k), derivatives of the state after the step by the state before
            it.
        slopes: float64 (m, outputs, k), derivatives of the readings by the state.
        gains: float64 (m, outputs, k), of the filter.
        variances: float64 (m, outputs), of the innovations.
        starts: int64 (m,), 1 where a stretch begins, else 0.
        shifts: float64 (m, k + outputs, probes), what each probe adds to the state after the step,
            and to the readings; it is not divided by the size of the probe's change.
    """

    samples: NDArray[np.int64]
    innovations: Array
    states: Array
    inputs: Array
    transitions: Array
    slopes: Array
    gains: Array
    variances: Array
    starts: NDArray[np.int64]
    shifts: Array

    def answers(
        self, rows: Sequence[int], rates: Array, shapes: Array | None = None,
        variances: Array | None = None, found: Array | None = None,
    ) -> Array:  # fmt: skip
        """Return the changes of the innovations by kicks, (m, outputs, columns).

        They are divided by the innovations' standard deviations, and 0 where a reading is not used.
        A kick has no effect beyond its stretch.

        Args:
            rows: what is kicked: the index of a state, or the number of states plus the index of an
                output.
            rates: float64 (m, rows, columns), sizes of the kicks by shapes of one, SI; or
                (m, rows, 1), if they are the same for all shapes.
            shapes: float64 (m, columns), by which the rates are multiplied; None for ones.
            variances: float64 (m, outputs), which the changes are divided by the roots of; None for
                those of the innovations.
            found: float64 (m, outputs, columns), to be written and returned; None for a new array.
        """
        if shapes is None:
            shapes = np.ones((len(self.samples), rates.shape[2]))
        if variances is None:
            variances = self.variances
        if found is None:
            found = np.empty((*variances.shape, shapes.shape[1]))
        respond(
            self.transitions, self.slopes, self.gains, np.ascontiguousarray(variances), self.starts,
            np.array(rows, dtype=np.int64), np.ascontiguousarray(rates),
            np.ascontiguousarray(shapes), found,
        )  # fmt: skip
        return found

    def pulls(self, weights: Array) -> Array:
        """Return the derivatives (m, k + outputs) of a weighted sum of answers by each kick.

        The columns belong to the states, then to the readings. The sum is that of `weights`
        (m, outputs) times the answers to a kick, so that a kick times its derivative is what it
        adds to the sum.
        """
        found = np.empty((len(self.samples), self.states.shape[1] + self.variances.shape[1]))
        pull_back(
            self.transitions, self.slopes, self.gains, self.variances, self.starts,
            np.ascontiguousarray(weights), found,
        )  # fmt: skip
        return found


def course_of(
    predictor: Predictor,
    record: Record,
    gains: Gains,
    values: Values,
    probes: Sequence[Mapping[str, float]],
    samples: NDArray[np.int64],
) -> Course:
    """Return stretches of a record, linearised about `values` with given gains.

    Args:
        predictor: predictor of the plant.
        record: record that the stretches belong to.
        gains: gains of a filter of the record.
        values: values of all parameters.
        probes: sets of values of all parameters, each with a small change of one or a few.
        samples: int64 (m,), indices in the record, ascending, at least one; a gap between them
            begins a new stretch.
    """
    plant = predictor.plant
    innovations, states = predictor.innovations(record, gains, values)
    count, outputs = states.shape[1], innovations.shape[1]
    places = np.full(len(record), -1, dtype=np.int64)
    places[samples] = np.arange(len(samples))
    transitions = np.empty((len(samples), count, count))
    slopes = np.empty((len(samples), outputs, count))
    shifts = np.empty((len(samples), count + outputs, len(probes)))
    last = int(samples[-1]) + 1
    along = Along(
        record.inputs[:last], states[:last], places[:last], predictor.extension(record, values)
    )
    written = Slopes(transitions, slopes, shifts)
    if predictor.are_alike([values, *probes]):
        predictor.linearise(record, values, probes, along, written)
    else:
        linearise_course(
            *predictor.functions, along,
            np.stack([plant.vector(each) for each in (values, *probes)]),
            predictor.memory(record, values, states[0]), predictor.changes, written,
        )  # fmt: skip
    return Course(
        samples, innovations[samples], states[samples], record.inputs[samples], transitions,
        slopes, np.ascontiguousarray(gains.states[samples]),
        np.ascontiguousarray(gains.variances[samples]),
        np.concatenate([[1], (np.diff(samples) != 1).astype(np.int64)]), shifts,
    )  # fmt: skip
