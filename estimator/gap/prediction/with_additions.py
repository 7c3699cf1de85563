"""Compiled functions here call the functions of a plant with what its model adds to them."""

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
from rig.plant import inlined


@inlined
def put(target, values):
    """Copy values (count,) to a target of the same length.

    Assigning to a slice would do the same. But the compiler would then prepare a message about the
    two lengths, in case they differ, and that takes two seconds in each process that compiles.
    """
    for i in range(target.size):
        target[i] = values[i]


class Scratch(NamedTuple):
    """Arrays for the additions of one sample.

    Attributes:
        measured: float64 (quantities and rates,), of `Plant.measures`.
        present: float64 (parameters,), with what the additions add to them.
        after: float64 (quantities and rates,), those at the end of the sample.
        followed: float64 (SLOTS, FOLLOWED), what each slot remembers of its quantity.
    """

    measured: Array
    present: Array
    after: Array
    followed: Array


@inlined
def scratch_of(parameters, extension):
    """Return arrays for the additions of a run; `present` begins as a copy of the parameters."""
    length = max(extension.measured, 1)
    scratch = Scratch(
        np.empty(length), np.empty(parameters.size), np.empty(length),
        np.full((SLOTS, FOLLOWED), np.nan),
    )  # fmt: skip
    put(scratch.present, parameters)
    return scratch


@inlined
def read_with(read, measures, extension, scratch, t, x, inputs, memory, parameters, readings):
    """Write to `readings` (outputs,) what the state `x` of sample `t` gives, without noise.

    The model's additions are included. The memory is not changed.
    """
    if extension.active & (SHOWS + VARIES) == 0:
        read(x, memory, parameters, readings)
    else:
        measures(x, inputs, parameters, scratch.measured)
        put(scratch.present, parameters)
        add_to_parameters(
            extension, parameters, scratch.measured, scratch.followed, t, scratch.present
        )
        read(x, memory, scratch.present, readings)
        add_to_readings(extension, parameters, scratch.measured, scratch.followed, t, readings)


@inlined
def drive_with(drive, measures, extension, scratch, t, x, inputs, memory, parameters):
    """Write to the memory what acts on the plant in sample `t`, with the model's additions.

    It follows from the inputs (inputs,), and the additions from the state `x`.
    """
    if extension.active & VARIES == 0:
        drive(inputs, memory, parameters)
    else:
        measures(x, inputs, parameters, scratch.measured)
        put(scratch.present, parameters)
        add_to_parameters(
            extension, parameters, scratch.measured, scratch.followed, t, scratch.present
        )
        drive(inputs, memory, scratch.present)


@inlined
def step_with(step, measures, extension, scratch, t, before, x, inputs, memory, parameters):
    """Write to `x` the state one sample after `before`, with the model's additions.

    `t` is the index of the sample of `before`. The plant's step may change the memory.
    """
    put(x, before)
    if extension.active & (KICKS + VARIES) == 0:
        step(x, memory, parameters)
    else:
        measures(before, inputs, parameters, scratch.measured)
        if extension.active & VARIES == 0:
            step(x, memory, parameters)
        else:
            put(scratch.present, parameters)
            add_to_parameters(
                extension, parameters, scratch.measured, scratch.followed, t, scratch.present
            )
            step(x, memory, scratch.present)
        add_to_state(extension, parameters, scratch.measured, scratch.followed, t, x)


@inlined
def remember_with(remember, measures, extension, scratch, before, x, inputs, memory, parameters):
    """Update what plant and additions remember, by the states before and after a sample.

    `inputs` (inputs,) are those of the sample. The memory (length,) of the plant and that of the
    additions, in `scratch`, are changed in place.
    """
    remember(before, x, memory, parameters)
    if extension.active & REMEMBERS != 0:
        measures(before, inputs, parameters, scratch.measured)
        measures(x, inputs, parameters, scratch.after)
        remember_quantities(
            extension, parameters, scratch.measured, scratch.after, scratch.followed
        )
