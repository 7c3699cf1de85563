"""This module makes predictions of records with one plant, for given values of its parameters."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from estimator.gap.plant import (
    PHASES,
    Array,
    Extension,
    Gains,
    Plant,
    Record,
    activity,
    kicked_states,
    made_of,
    roughness,
)
from rig.lanes import LANES, aligned, empty_lanes

from .prediction import (
    Along,
    Begun,
    Setup,
    Slopes,
    Track,
    predict_ahead,
    run_filter,
    run_free,
    run_frozen,
)
from .side_by_side import linearise_in_lanes, run_filter_in_lanes, run_frozen_in_lanes
from .variables import Values

_FIRST = 20
"""Number of samples at the start of a record from which the first state is estimated."""


class Predictor:
    """Filters, predicts and simulates records with a plant.

    `values`, in all methods, are values of all parameters by name, SI. The results are not finite
    where the plant breaks down with them.

    Attributes:
        plant: the plant.
        functions: its compiled functions `drive`, `step`, `remember`, `read` and `measures`.
        changes: float64 (states,), changes of the states by which derivatives are taken.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant = plant
        self.functions = (plant.drive, plant.step, plant.remember, plant.read, plant.measures)
        self._kicked = kicked_states(plant.equations)
        self._changed = (
            plant.layout.changed if plant.layout else np.full((1, 2), -1, dtype=np.int64)
        )
        self.changes = np.array([state.change for state in plant.states])
        self._noises = np.array([state.noise for state in plant.states]) ** 2

    def memory(self, record: Record, values: Values, start: Array) -> Array:
        """Return the memory (1, length) at a record's first sample, with the state `start`."""
        time_s = record.first * self.plant.period
        return self.plant.begin(start, record.inputs[:_FIRST], values, time_s)[None, :].copy()

    def _begun(self, record: Record, values: Values, start: Array) -> Begun:
        return Begun(
            self.plant.vector(values), start, self.memory(record, values, start),
            self.extension(record, values),
        )  # fmt: skip

    def extension(self, record: Record, values: Values) -> Extension:
        """Return what compiled functions must know of the additions that the values hold.

        The record gives the time of its first sample and the number of its recording.
        """
        plant, quantities = self.plant, len(self.plant.regions)
        return Extension(
            self._kicked, self._changed, len(plant.own_parameters),
            self._active(values), quantities + 2 * len(plant.equations),
            quantities, record.first * plant.period, plant.period, min(record.number, PHASES - 1),
        )  # fmt: skip

    def _kind(self, values: Values) -> tuple[float, ...] | None:
        """Return what runs in the same lanes must have in common; None if the run must be alone.

        A plant without lanes runs alone. All else is said by `InLanes.kind`, and by which kinds of
        places the additions enter that the values hold.
        """
        in_lanes = self.plant.in_lanes
        kind = None if in_lanes is None else in_lanes.kind(values)
        return None if kind is None else (*kind, self._active(values))

    def _active(self, values: Values) -> int:
        return activity(values) if self.plant.layout else 0

    def _start(self, record: Record, values: Values) -> tuple[Array, Array]:
        first = np.where(np.isfinite(record.variances[:_FIRST]), record.readings[:_FIRST], np.nan)
        first[0] = record.readings[0]
        return self.plant.start(first, record.inputs[:_FIRST], values)

    def filter(self, record: Record, values: Values) -> Gains:
        """Return the gains of a filter that runs over a record with these parameter values.

        Readings near violent samples count less (`roughness`). If the plant can run in lanes with
        these values, its derivatives are taken there, which changes the last digits only.
        """
        plant = self.plant
        samples, outputs, states = *record.readings.shape, len(plant.states)
        gains = Gains(
            np.empty((samples, outputs, states)),
            np.empty((samples, outputs)),
            np.empty((samples, outputs, outputs)),
        )
        start, spread = self._start(record, values)
        variances = record.variances + roughness(record, plant, values)
        parameters = plant.vector(values)
        shares = plant.shares(values) if plant.shares else np.ones((outputs, states))
        track = Track(record.inputs, record.readings, *gains)
        setup = Setup(
            variances, parameters, start, spread, self.changes, self._noises, shares,
            self.memory(record, values, start), self.extension(record, values),
        )  # fmt: skip
        in_lanes = plant.in_lanes
        if in_lanes is None or self._kind(values) is None:
            run_filter(*self.functions, track, setup)
            return gains
        together = np.repeat(start[:, None], LANES, axis=1)
        memory = in_lanes.begin(together, record.inputs[:_FIRST], [values] * LANES)
        acting = in_lanes.acting(values) if in_lanes.acting else np.arange(states)
        run_filter_in_lanes(
            in_lanes.drive, in_lanes.step, in_lanes.remember, plant.remember, plant.read,
            plant.measures, track, setup,
            aligned(np.repeat(parameters[:, None], LANES, axis=1)), aligned(memory), acting,
        )  # fmt: skip
        return gains

    def innovations(self, record: Record, gains: Gains, values: Values) -> tuple[Array, Array]:
        """Return the innovations (n, outputs) and the filtered states (n, states) of a record.

        The innovations are divided by their standard deviations, and 0 where a reading is not used.

        Args:
            record: record to be predicted.
            gains: gains of `filter`, with these values or others.
            values: values of all parameters.
        """
        innovations = np.empty_like(record.readings)
        states = np.empty((len(record), len(self.changes)))
        begun = self._begun(record, values, self._start(record, values)[0])
        track = Track(record.inputs, record.readings, *gains)
        run_frozen(*self.functions, track, begun, innovations, states)
        return innovations, states

    def groups(self, values: Sequence[Values]) -> list[list[int]]:
        """Return which sets of values may run together in lanes, as groups of their indices.

        Sets that are of the same kind (`InLanes.kind`) share groups of at most LANES - 1 members:
        the caller runs each group in one call of `innovations_of`, together with the values with
        which the group is compared, which take one lane. A set that must run alone is a group by
        itself, and so is every set if the plant has no lanes.
        """
        alike: dict[tuple[float, ...], list[int]] = {}
        found: list[list[int]] = []
        for index, each in enumerate(values):
            kind = self._kind(each)
            if kind is None:
                found.append([index])
            else:
                alike.setdefault(kind, []).append(index)
        for members in alike.values():
            rounds = -(-len(members) // (LANES - 1))
            found += [members[k::rounds] for k in range(rounds)]
        return found

    def innovations_of(self, record: Record, gains: Gains, values: Sequence[Values]) -> list[Array]:
        """Return the innovations (n, outputs) that `innovations` gives, for each set of values.

        There must be one to LANES sets, all of one kind (`InLanes.kind`). They run side by side in
        lanes; the last digits differ, because e^x rounds differently there. If sets of their kind
        must run alone, or if the plant has no lanes, they run one after the other.
        """
        plant, in_lanes = self.plant, self.plant.in_lanes
        if in_lanes is None or self._kind(values[-1]) is None:
            return [self.innovations(record, gains, each)[0] for each in values]
        padded = [*values, *[values[-1]] * (LANES - len(values))]
        starts = aligned(np.column_stack([self._start(record, each)[0] for each in padded]))
        parameters = aligned(np.column_stack([plant.vector(each) for each in padded]))
        innovations = empty_lanes(record.readings.size).reshape((*record.readings.shape, LANES))
        memory = aligned(in_lanes.begin(starts, record.inputs[:_FIRST], padded))
        track = Track(record.inputs, record.readings, *gains)
        run_frozen_in_lanes(
            in_lanes.drive, in_lanes.step, in_lanes.remember, in_lanes.read, plant.measures, track,
            Begun(parameters, starts, memory, self.extension(record, values[-1])),
            plant.vector(values[0]), innovations,
        )  # fmt: skip
        return [innovations[:, :, lane] for lane in range(len(values))]

    def are_alike(self, values: Sequence[Values]) -> bool:
        """Return whether all sets of values may run in the same lanes (`InLanes.kind`)."""
        kinds = {self._kind(each) for each in values}
        return len(kinds) == 1 and None not in kinds

    def linearise(
        self, record: Record, values: Values, probes: Sequence[Values], along: Along,
        written: Slopes,
    ) -> None:  # fmt: skip
        """Write the linearisation of a plant along a filtered course, in lanes.

        `values` and all `probes` must be alike (`are_alike`).

        Args:
            record: record that the course belongs to.
            values: values of all parameters.
            probes: sets of values of all parameters, each with a small change.
            along: the course.
            written: the linearisation, which is written.
        """
        plant, in_lanes = self.plant, self.plant.in_lanes
        if in_lanes is None:
            raise ValueError("the plant does not run in lanes")
        present = plant.vector(values)
        sets = [present] * len(plant.states) + [plant.vector(each) for each in probes]
        rows = [np.repeat(present[:, None], LANES, axis=1)]
        for first in range(0, len(sets), LANES - 1):
            some = [present, *sets[first : first + LANES - 1]]
            rows.append(np.column_stack([*some, *[present] * (LANES - len(some))]))
        parameters = empty_lanes(len(rows) * present.size).reshape(len(rows), -1, LANES)
        parameters[:] = rows
        start = np.repeat(along.states[0][:, None], LANES, axis=1)
        memory = in_lanes.begin(start, record.inputs[:_FIRST], [values] * LANES)
        linearise_in_lanes(
            in_lanes.drive, in_lanes.step, in_lanes.remember, in_lanes.read, plant.measures, along,
            parameters, present, aligned(memory), self.changes, written,
        )  # fmt: skip

    def ahead(self, record: Record, values: Values, states: Array) -> Array:
        """Return readings less predictions (n, outputs), SI, over the plant's horizon.

        `states` are the filtered states (n, states) that `innovations` gives. From these the
        predictions start anew each time a horizon is over, and in between they get the inputs
        alone. The result is NaN at the samples of the starts, and where a reading is missing or
        saturated.
        """
        predicted = np.empty_like(record.readings)
        predict_ahead(
            *self.functions, record.inputs, states, self._begun(record, values, states[0]),
            round(self.plant.horizon / self.plant.period), predicted,
        )  # fmt: skip
        errors = record.readings - predicted
        errors[~np.isfinite(record.variances)] = np.nan
        return errors

    def simulate(self, record: Record, values: Values, *, steered: bool) -> tuple[Array, Array]:
        """Simulate a record; return inputs (n, inputs) and noise-free readings (n, outputs).

        The inputs are those of the record. If the simulation is steered, they are changed in the
        result by the feedback `Plant.steering`, to keep the simulation on the record's course.
        """
        steering = np.zeros((len(self.plant.inputs), len(self.plant.outputs)))
        if steered:
            for index, output, gain in self.plant.steering:
                steering[index, output] = gain
        driven, simulated = record.inputs.copy(), np.empty_like(record.readings)
        begun = self._begun(record, values, self._start(record, values)[0])
        run_free(*self.functions, driven, record.readings, begun, steering, simulated)
        return driven, simulated

    def twin(self, record: Record, values: Values, seed: int) -> Record:
        """Return what a rig that is exactly this model would have recorded on the same course.

        Its sensors have the noise (drawn with `seed`), the rounding and the range that the plant
        states, and steering keeps it near the course: its inputs are those applied. Readings that
        are missing or saturated in the record have an infinite variance in the twin, too.
        """
        driven, simulated = self.simulate(record, values, steered=True)
        generator = np.random.default_rng(seed)
        for index, output in enumerate(self.plant.outputs):
            noisy = simulated[:, index] + output.noise * generator.standard_normal(len(record))
            if output.resolution > 0.0:
                noisy = np.round(noisy / output.resolution) * output.resolution
            simulated[:, index] = np.clip(noisy, output.lower, output.upper)
        twin = made_of(f"twin of {record.source}", driven, simulated, self.plant)
        # Readings that the recording lacks must be missing in its twin as well.
        twin.variances[~np.isfinite(record.variances)] = np.inf
        return replace(twin, first=record.first, number=record.number)
