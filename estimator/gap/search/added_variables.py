"""This module makes the variables with which disturbances of a model are refitted.

It also says whether a model may hold a disturbance as it was fitted.
"""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from estimator.gap.plant import MEMORIES, Addition, Layout, Plant
from estimator.gap.prediction import Filtered, Values, Variable

from .disturbances import Place
from .shapes import CORNERS
from .standing_in import ADDED

_TURN: Final = 1e-3
"""1/s. The period T of a tone is moved by this times T^2 to see what it changes: its phase then
turns by 2 pi times this in a second."""
_CORNER: Final = 0.3
"""Part of its value by which the place of a corner may move from that which was chosen: as far as
to the next one that was tried."""
_LARGEST: Final = {"lag": np.inf, "frequency": np.inf, "damping": 0.95, "play": np.inf}
"""Greatest values in what remembers: with a damping ratio of one it swings no more."""

_FACTORS: Final = {
    "lag": (("lag", 4.0),),
    "resonance": (("frequency", 1.3), ("damping", 6.0)),
    "play": (("play", 3.0),),
}
"""By which factor a fit may change what each of `MEMORIES` has, from the value it began with."""


def addition_variables(
    layout: Layout, additions: Sequence[Addition], which: Iterable[int]
) -> tuple[Variable, ...]:
    """Return the variables with which some of a model's additions are refitted.

    They are all values of a table, and of a form in symbols its size, with the period and phase of
    a wave, the period and the known phases of a tone, the middle and width of a bump, the time
    constant of a lag, the frequency and damping of a resonance, the width of a play, or the place
    of a corner. Knots of
    a table stay. Their name is `ADDED`, and each key is the name of the parameter.

    Args:
        layout: how models of the plant hold additions.
        additions: all additions of the model.
        which: indices of those that are refitted.
    """
    found: list[Variable] = []
    for index in which:
        each = additions[index]
        sizes, places = layout.names(additions, index)
        largest = max(max(abs(value) for value in each.values), 1e-300)
        lower, upper = -10.0 * largest, 10.0 * largest
        if each.form == "play" and each.place.startswith("reading of "):
            # With more than one, the reading would move against what it reads.
            lower, upper = 0.0, 1.0
        steps = [(name, 0.03 * largest, lower, upper) for name in sizes]
        if each.form == "tone":
            period = each.at[0]
            probe = _TURN * period * period
            steps.append((places[0], probe, period / 1.3, period * 1.3))
            steps += [
                (name, 0.03, phase - 10.0, phase + 10.0)
                for name, phase in zip(places[1:], each.at[1:], strict=True)
                if phase != 0.0
            ]
        elif each.form == "wave":
            pitch, phase = each.at
            steps.append((places[0], 1e-3 * pitch, pitch / 1.3, pitch * 1.3))
            steps.append((places[1], 0.03, phase - 10.0, phase + 10.0))
        elif each.form in MEMORIES:
            times = _FACTORS[each.form]
            steps += [
                (name, 0.01 * value, value / factor, min(value * factor, _LARGEST[kind]))
                for name, value, (kind, factor) in zip(places, each.at, times, strict=True)
            ]
        elif each.form in CORNERS:
            reach = _CORNER * abs(each.at[0])
            if reach > 0.0:
                steps.append((places[0], 0.03 * reach, each.at[0] - reach, each.at[0] + reach))
        elif each.form == "bump":
            middle, width = each.at
            steps.append((places[0], 0.03 * width, middle - 2.0 * width, middle + 2.0 * width))
            steps.append((places[1], 0.03 * width, width / 3.0, width * 3.0))
        found += [
            Variable(name, name, probe, lower, upper, name=ADDED)
            for name, probe, lower, upper in steps
        ]
    return tuple(found)


def renamed(
    layout: Layout,
    variables: Sequence[Variable],
    before: Sequence[Addition],
    after: Sequence[Addition],
) -> tuple[Variable, ...]:
    """Return variables of additions with the parameters that hold these among more additions.

    A layout may hold an addition elsewhere once another one joins it: the rig's terms begin with
    tables. All other variables stay as they are.

    Args:
        layout: how models of the plant hold additions.
        variables: variables of a fit, some of which may be those of `before`.
        before: all additions of the model of that fit.
        after: additions that begin with those of `before`.
    """
    moved: dict[str, str] = {}
    for index in range(len(before)):
        for old, new in zip(layout.names(before, index), layout.names(after, index), strict=True):
            moved.update(zip(old, new, strict=True))
    return tuple(
        replace(each, parameter=moved[each.parameter], key=moved[each.parameter])
        if each.name == ADDED
        else each
        for each in variables
    )


def errors_of(
    filtered: Filtered, values: Values, variables: Sequence[Variable]
) -> dict[str, float]:
    """Return the standard error of each variable that is not held, by the parameter's name.

    Logarithmic variables have that of the logarithm. `filtered` has the records with gains for the
    fitted `values`.
    """
    columns = filtered.columns(values, variables)
    linear = filtered.linearise(values, columns)
    free = [(c.name, v) for c, v in zip(columns, variables, strict=True) if not v.is_held]
    names = [name for name, _ in free]
    errors = linear.errors(names, linear.solve(names)[0])
    return {v.parameter: float(error) for (_, v), error in zip(free, errors, strict=True)}


def refitted(layout: Layout, values: Values, additions: Sequence[Addition]) -> list[Addition]:
    """Return a model's additions with the sizes and places that values of all parameters give them.

    The result has the order of `additions`; `Layout.additions` may return another one.
    """
    found = []
    for index, each in enumerate(additions):
        sizes, places = layout.names(additions, index)
        found.append(
            replace(
                each,
                values=tuple(float(values[name]) for name in sizes),
                at=tuple(float(values[name]) for name in places),
            )
        )
    return found


def is_possible(plant: Plant, values: Values, place: Place, addition: Addition) -> bool:
    """Return whether a table leaves the parameters that it changes at or above their least values.

    A friction level below zero would be a force that drives the ram. Other places have no least
    value, and forms in symbols are not looked at.
    """
    if place.varying is None or not addition.values:
        return True
    least = min(addition.values) if addition.form == "table" else 0.0
    lower = {each.name: each.lower for each in plant.parameters}
    return all(values[name] + least >= lower[name] for name in place.varying.parameters)
