"""What a model's states were off by, as samples to which a correction can be fitted.

A target is the disturbance of one equation, for each state that an equation of the plant changes.
The quantities that it may depend on are those that the gap workflow has for the equations of that
state, with the time.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Equation, Plant
from estimator.gap.search.disturbances import TIME
from tools.peers.course import Course, Kicks, Values

FACTORS: Final = (1.0, 4.0, 16.0)
"""Factors on the model error that the plant states, which are tried to find disturbances. A
smoother that trusts its model takes a part of what is missing for noise; one that does not takes
noise for something that is missing."""
EVERY: Final = 10
"""One sample in so many is fitted to, because the smoother's disturbances of neighbouring samples
hardly differ."""
OUTLIERS: Final = 5.0
"""Standard deviations, by the median deviation. Disturbances farther from their median count as so
far: a ram that breaks away is nowhere near the linear course of a smoother."""
MATTERS: Final = 0.05
"""A correction depends on a quantity that is behind this part of its variance, or more."""


@dataclass(frozen=True)
class Target:
    """The disturbance of one equation.

    Attributes:
        equation: the equation; its disturbance enters one state only.
        quantities: names of the regions on which it may depend.
        periodic: those of them along which it may repeat: which the plant calls periodic, or which
            are angles.
        error: standard deviation of the disturbance that the plant's model admits to, SI.
    """

    equation: Equation
    quantities: tuple[str, ...]
    periodic: tuple[str, ...]
    error: float

    def along(self, plant: Plant, states: Array, inputs: Array, time_s: Array) -> Array:
        """Return the quantities (n, quantities) at states (n, k), inputs (n, i) and times (n,)."""
        return np.column_stack(
            [
                time_s if name == TIME.name else plant.regions[name].value(states, inputs)
                for name in self.quantities
            ]
        )


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one target in one record.

    Attributes:
        quantities: float64 (n, d), SI.
        values: float64 (n,), disturbances, SI.
    """

    quantities: Array
    values: Array


Learned = Callable[[Array], Array]
"""A fitted curve: quantities (n, d), SI -> disturbances (n,), SI."""


@dataclass(frozen=True, eq=False)
class Learner:
    """A way to fit a curve to samples.

    Attributes:
        name: shown in tables.
        fit: (samples of each record, their target, whether it is the last fit and may take its
            time) -> the curve, or None if none is better than nothing on records that it
            was not fitted to; and the curve in words.
    """

    name: str
    fit: Callable[[Sequence[Samples], Target, bool], tuple[Learned | None, str]]


@dataclass(frozen=True, eq=False)
class Part:
    """What was learned of one target.

    Attributes:
        target: the target.
        curve: what was learned.
        lower: float64 (d,), least quantities that it was fitted to; lesser ones count as these.
        upper: float64 (d,), the greatest.
        text: the curve in words.
    """

    target: Target
    curve: Learned
    lower: Array
    upper: Array
    text: str

    def values(self, quantities: Array) -> Array:
        """Return the disturbance (n,), SI, at quantities (n, d)."""
        return self.curve(np.clip(quantities, self.lower, self.upper))

    def depends_on(self, quantities: Array, seed: int = 1) -> tuple[str, ...]:
        """Return the quantities that are behind `MATTERS` of the variance along samples (n, d).

        A quantity is shuffled among the samples, and the half of the mean squared change is what it
        is behind (total effect of Sobol, as Jansen 1999 estimates it).
        """
        rng = np.random.default_rng(seed)
        values = self.values(quantities)
        whole = float(values.var())
        found = []
        for index, name in enumerate(self.target.quantities):
            shuffled = quantities.copy()
            shuffled[:, index] = rng.permutation(shuffled[:, index])
            behind = 0.5 * float(np.mean((self.values(shuffled) - values) ** 2))
            if behind > MATTERS * whole > 0.0:
                found.append(name)
        return tuple(found)


def targets_of(plant: Plant) -> list[Target]:
    """Return the targets of a plant: the first equation of each state that changes it alone.

    An equation that changes two states at once needs no target of its own, because both states have
    one; its quantities are among theirs.
    """
    found: dict[int, Target] = {}
    of: dict[int, list[str]] = {}
    for equation in plant.equations:
        for state in (equation.state, *(state for state, _ in equation.also)):
            of.setdefault(state, []).extend(equation.of)
    for equation in plant.equations:
        if equation.also or equation.state in found:
            continue
        rest = np.zeros((1, len(plant.states)))
        names = tuple(dict.fromkeys([*of[equation.state], TIME.name]))
        rate = abs(float(equation.rate(rest, plant.nominal)[0]))
        error = plant.states[equation.state].noise / rate if rate > 0.0 else 0.0
        periodic = tuple(
            name
            for name in names
            if name != TIME.name
            and (plant.regions[name].periodic or plant.regions[name].unit == "rad")
        )
        found[equation.state] = Target(equation, names, periodic, error)
    return list(found.values())


def trusting_less(plant: Plant, factor: float) -> Plant:
    """Return the plant with the error that its model admits to multiplied by a factor."""
    states = tuple(replace(state, noise=factor * state.noise) for state in plant.states)
    return replace(plant, states=states)


def samples_of(target: Target, course: Course) -> Samples:
    """Return the samples of a target along a course."""
    plant = course.plant
    rate = target.equation.rate(course.states, course.values)
    kept = course.settled & (rate != 0.0)
    kept[-round(plant.horizon / plant.period) :] = False
    rows = np.flatnonzero(kept)[::EVERY]
    found = course.disturbances[rows, target.equation.state] / rate[rows]
    quantities = target.along(plant, course.states, course.record.inputs, course.time_s)[rows]
    fine = np.isfinite(found) & np.isfinite(quantities).all(axis=1)
    return Samples(quantities[fine], _without_outliers(found[fine]))


def _without_outliers(values: Array) -> Array:
    """Return values (n,) of which the farthest from the median are at `OUTLIERS` deviations."""
    if not len(values):
        return values
    middle = np.median(values)
    reach = OUTLIERS * 1.4826 * float(np.median(np.abs(values - middle)))
    return np.clip(values, middle - reach, middle + reach)


def learned(
    learner: Learner, target: Target, samples: Sequence[Samples], last: bool
) -> Part | None:
    """Return what a learner finds of a target in samples of several records; None if nothing.

    `last` says that it is the last fit, and may take its time.
    """
    curve, text = learner.fit(samples, target, last)
    if curve is None:
        return None
    together = np.concatenate([each.quantities for each in samples])
    return Part(target, curve, together.min(axis=0), together.max(axis=0), text)


def kicks_of(parts: Sequence[Part], plant: Plant, values: Values) -> Kicks:
    """Return the correction that adds what was learned to the plant's states."""

    def kicks(states: Array, inputs: Array, time_s: Array) -> Array:
        added = np.zeros_like(states)
        for part in parts:
            quantities = part.target.along(plant, states, inputs, time_s)
            fine = np.isfinite(quantities).all(axis=1)
            rate = part.target.equation.rate(states[fine], values)
            added[fine, part.target.equation.state] = part.values(quantities[fine]) * rate
        return added

    return kicks


def strongest(parts: Sequence[Part], courses: Sequence[Course]) -> list[tuple[Part, float, Array]]:
    """Return the parts by falling size, each with its size and its quantities (n, d) along courses.

    The size is the root mean square of the disturbance, in standard deviations of the model error
    that the plant admits to.
    """
    found = []
    for part in parts:
        quantities = np.concatenate(
            [
                part.target.along(c.plant, c.states, c.record.inputs, c.time_s)[c.settled][::EVERY]
                for c in courses
            ]
        )
        size = float(np.sqrt(np.mean(part.values(quantities) ** 2))) / max(
            part.target.error, 1e-300
        )
        found.append((part, size, quantities))
    return sorted(found, key=lambda each: -each[1])
