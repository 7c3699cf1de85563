"""This module defines what a fit changes: nuisances and the knobs of effects, within bounds."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import exp, log

from estimator.gap.plant import Effect, Knob, Nuisance, Plant

from .linear import Column

Values = Mapping[str, float]

_LARGEST_SHARE = 0.1
"""Greatest change by a probe, as a part of the value, if the variable is logarithmic."""


@dataclass(frozen=True, slots=True)
class Variable(Knob):
    """One parameter that is fitted: a knob of an effect, or a nuisance, whose `key` is empty.

    Its bounds are those of the fit. If it is logarithmic, steps are steps of the value's logarithm;
    `probe` is a change of the value itself all the same.

    Attributes:
        name: name of the effect, or of the parameter if it is a nuisance.
    """

    name: str = ""

    def put(self, values: Values, value: float) -> dict[str, float]:
        """Return a copy of all values in which this parameter has the value given.

        The bounds are not checked. The parameters that follow it are scaled by the same factor; the
        parameter must not have been 0 if there are any.
        """
        changed = dict(values)
        changed[self.parameter] = value
        before = values[self.parameter]
        for follower in self.follows:
            changed[follower] = values[follower] * value / before
        return changed

    def held(self, values: Values) -> "Variable":
        """Return this variable with bounds that leave it no other value than that in `values`."""
        at = values[self.parameter]
        return replace(self, lower=at, upper=at)

    @property
    def is_held(self) -> bool:
        """Return whether the bounds leave it one value."""
        return self.lower == self.upper

    def within(self, value: float) -> float:
        """Return the value, or the bound that it is beyond."""
        return min(max(value, self.lower), self.upper)

    def column(self, values: Values) -> Column:
        """Return this variable's column: the values after its probe, and the bounds of a step.

        The probe goes down if it would exceed the upper bound. The steps of a logarithmic variable
        are those of the logarithm, and its probe is at most a tenth of the value.
        """
        at = values[self.parameter]
        probe = self.probe
        if self.logarithmic:
            probe = min(probe, _LARGEST_SHARE * at)
        if at + probe > self.upper:
            probe = -probe
        changed = self.put(values, at + probe)
        name = f"{self.name}.{self.key}"
        if self.logarithmic:
            lower, upper = log(self.lower / at), log(self.upper / at)
            return Column(name, changed, log((at + probe) / at), lower, upper)
        return Column(name, changed, probe, self.lower - at, self.upper - at)

    def moved(self, values: Values, step: float) -> dict[str, float]:
        """Return all values after a step of this variable, cut off at its bounds.

        The step is of the value, or of its logarithm, at most 5 either way, if the variable is
        logarithmic. Parameters that follow are scaled along.
        """
        at = values[self.parameter]
        if self.logarithmic:
            return self.put(values, self.within(at * exp(min(max(step, -5.0), 5.0))))
        return self.put(values, self.within(at + step))

    def reach(self, values: Values, step: float) -> float:
        """Return how much the value itself changes by a small step of this variable, SI."""
        return step * values[self.parameter] if self.logarithmic else step


def nuisance_variable(nuisance: Nuisance) -> Variable:
    """Return the variable of a nuisance, whose bounds are the ends of the tolerance."""
    width = nuisance.tolerance * abs(nuisance.nominal)
    lower, upper = nuisance.nominal - width, nuisance.nominal + width
    name = nuisance.parameter
    return Variable("", name, nuisance.probe, lower, upper, name=name)


def effect_variables(effect: Effect) -> tuple[Variable, ...]:
    """Return the variables of all knobs of an effect."""
    return tuple(Variable(**asdict(knob), name=effect.name) for knob in effect.knobs)


def freed(variables: tuple[Variable, ...], effect: Effect) -> tuple[Variable, ...]:
    """Return the variables without those of an effect's parameters, followed by the effect's own.

    So an effect's variable takes the place of a nuisance with the same parameter.
    """
    added = effect_variables(effect)
    taken = {variable.parameter for variable in added}
    return (*(variable for variable in variables if variable.parameter not in taken), *added)


def with_effect_of(values: Values, effect: Effect, others: Values) -> dict[str, float]:
    """Return a copy of all values in which an effect's parameters are as in other values."""
    changed = dict(values)
    for variable in effect_variables(effect):
        changed = variable.put(changed, others[variable.parameter])
    return changed


def started(
    plant: Plant, values: Values, effect: Effect, start: Mapping[str, float]
) -> dict[str, float]:
    """Return a copy of all values in which an effect's knobs have the values of a start, by key.

    A knob that the start lacks keeps its value.
    """
    changed = dict(values)
    for variable in effect_variables(effect):
        if variable.key in start:
            changed = variable.put(changed, start[variable.key])
    return changed
