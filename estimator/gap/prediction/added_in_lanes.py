"""Compiled functions here call the functions of a plant in lanes with what its model adds to them.

They do for lanes what `with_additions` does for a run alone. What the additions are is computed for
one lane after the other, which takes a part of the time of the plant's step.
"""

from typing import NamedTuple

import numpy as np

from estimator.gap.plant import (
    FOLLOWED,
    KICKS,
    REMEMBERS,
    SHOWS,
    SLOTS,
    VARIES,
    Array,
    add_to_parameters,
    add_to_readings,
    add_to_state,
    remember_quantities,
)
from rig.lanes import LANES, empty_lanes
from rig.plant import inlined


class LanesScratch(NamedTuple):
    """Arrays for the additions of one sample in lanes.

    A batch is a set of lanes with parameters of their own.

    Attributes:
        each: float64 (batches, LANES, parameters), the parameters of each lane.
        present: float64 (batches, LANES, parameters), with what the additions add to them.
        varied: float64 (batches, parameters, LANES), the same as the functions in lanes take it.
        measured: float64 (LANES, quantities and rates), of `Plant.measures` before a step.
        after: float64 (quantities and rates,), those of one lane at the end of the sample.
        followed: float64 (LANES, SLOTS, FOLLOWED), what each slot remembers of its quantity.
        point: float64 (states,), the state of one lane.
        shown: float64 (outputs,), the readings of one lane.
    """

    each: Array
    present: Array
    varied: Array
    measured: Array
    after: Array
    followed: Array
    point: Array
    shown: Array


@inlined
def lanes_scratch_of(parameters, extension, states, outputs):
    """Return arrays for the additions of a run in lanes.

    Args:
        parameters: float64 (batches, parameters, LANES).
        extension: what the model's additions need.
        states: number of states.
        outputs: number of outputs.
    """
    batches, count, length = parameters.shape[0], parameters.shape[1], max(extension.measured, 1)
    scratch = LanesScratch(
        np.empty((batches, LANES, count)), np.empty((batches, LANES, count)),
        empty_lanes(batches * count).reshape((batches, count, LANES)),
        np.empty((LANES, length)), np.empty(length), np.full((LANES, SLOTS, FOLLOWED), np.nan),
        np.empty(states), np.empty(outputs),
    )  # fmt: skip
    for batch in range(batches):
        for i in range(count):
            for lane in range(LANES):
                value = parameters[batch, i, lane]
                scratch.each[batch, lane, i] = value
                scratch.present[batch, lane, i] = value
                scratch.varied[batch, i, lane] = value
    return scratch


@inlined
def _measure(measures, scratch, batch, states, inputs):
    """Write to `scratch.measured` the quantities and rates at the states (states, LANES)."""
    for lane in range(LANES):
        for i in range(scratch.point.size):
            scratch.point[i] = states[i, lane]
        measures(scratch.point, inputs, scratch.each[batch, lane], scratch.measured[lane])


@inlined
def _vary(extension, scratch, batch, t):
    """Write to `scratch.varied` the parameters of sample `t` with what is added to them."""
    changed = extension.changed
    for lane in range(LANES):
        add_to_parameters(
            extension, scratch.each[batch, lane], scratch.measured[lane], scratch.followed[lane], t,
            scratch.present[batch, lane],
        )  # fmt: skip
        for row in range(changed.shape[0]):
            for k in range(changed.shape[1]):
                index = changed[row, k]
                if index >= 0:
                    scratch.varied[batch, index, lane] = scratch.present[batch, lane, index]


@inlined
def read_lanes(
    read, measures, extension, scratch, batch, t, states, inputs, memory, parameters, first,
    readings,
):  # fmt: skip
    """Write to `readings` (outputs, LANES) what the states of sample `t` give, with additions.

    `batch` is the index of the lanes' parameters in the scratch.
    """
    if extension.active & (SHOWS + VARIES) == 0:
        read(states, memory, parameters, first, readings)
    else:
        _measure(measures, scratch, batch, states, inputs)
        if extension.active & VARIES == 0:
            read(states, memory, parameters, first, readings)
        else:
            _vary(extension, scratch, batch, t)
            read(states, memory, scratch.varied[batch], first, readings)
        if extension.active & SHOWS != 0:
            for lane in range(LANES):
                for i in range(scratch.shown.size):
                    scratch.shown[i] = readings[i, lane]
                add_to_readings(
                    extension, scratch.each[batch, lane], scratch.measured[lane],
                    scratch.followed[lane], t, scratch.shown,
                )  # fmt: skip
                for i in range(scratch.shown.size):
                    readings[i, lane] = scratch.shown[i]


@inlined
def step_lanes(
    step, measures, extension, scratch, batch, t, states, inputs, memory, parameters, first
):
    """Advance the states (states, LANES) in place by sample `t`, with the model's additions.

    `batch` is the index of the lanes' parameters in the scratch. If a slot remembers its quantity,
    `scratch.measured` has the quantities before the step afterwards, as `remember_lanes` needs
    them.
    """
    if extension.active & (KICKS + VARIES + REMEMBERS) == 0:
        step(states, memory, parameters, first)
    else:
        _measure(measures, scratch, batch, states, inputs)
        if extension.active & VARIES == 0:
            step(states, memory, parameters, first)
        else:
            _vary(extension, scratch, batch, t)
            step(states, memory, scratch.varied[batch], first)
        if extension.active & KICKS != 0:
            for lane in range(LANES):
                for i in range(scratch.point.size):
                    scratch.point[i] = states[i, lane]
                add_to_state(
                    extension, scratch.each[batch, lane], scratch.measured[lane],
                    scratch.followed[lane], t, scratch.point,
                )  # fmt: skip
                for i in range(scratch.point.size):
                    states[i, lane] = scratch.point[i]


@inlined
def remember_lanes(
    remember, measures, extension, scratch, batch, states, inputs, memory, parameters, first
):
    """Update what plant and additions remember, by the states (states, LANES) after a sample."""
    remember(states, memory, parameters, first)
    if extension.active & REMEMBERS != 0:
        for lane in range(LANES):
            for i in range(scratch.point.size):
                scratch.point[i] = states[i, lane]
            measures(scratch.point, inputs, scratch.each[batch, lane], scratch.after)
            remember_quantities(
                extension, scratch.each[batch, lane], scratch.measured[lane], scratch.after,
                scratch.followed[lane],
            )  # fmt: skip


@inlined
def follow_course(extension, followed, scratch):
    """Make all lanes remember of their quantities what a course does, (SLOTS, FOLLOWED)."""
    if extension.active & REMEMBERS != 0:
        for lane in range(LANES):
            for slot in range(followed.shape[0]):
                for i in range(followed.shape[1]):
                    scratch.followed[lane, slot, i] = followed[slot, i]
