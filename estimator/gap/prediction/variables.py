"""What a fit moves: nuisances and the knobs of effects, each a parameter within bounds."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import exp, log

from estimator.gap.plant import Effect, Knob, Nuisance, Plant

from .linear import Column

Values = Mapping[str, float]

_LARGEST_SHARE = 0.1
"""Part of a value on a logarithmic scale by which a probe may change it."""


@dataclass(frozen=True, slots=True)
class Variable:
    """One parameter to fit.

    Attributes:
        name: of the effect, or of the nuisance's parameter.
        key: of the effect's knob, empty for a nuisance.
        parameter: of the plant.
        probe: change for derivatives by differences.
        lower: bound.
        upper: bound.
        follows: parameters that change in proportion.
        logarithmic: whether steps are of the logarithm of the value; `probe` stays a change of the
            value itself.
    """

    name: str
    key: str
    parameter: str
    probe: float
    lower: float
    upper: float
    follows: tuple[str, ...] = ()
    logarithmic: bool = False

    def put(self, values: Values, value: float) -> dict[str, float]:
        """Return values with this parameter, and what follows it, set."""
        changed = dict(values)
        changed[self.parameter] = value
        before = values[self.parameter]
        for follower in self.follows:
            changed[follower] = values[follower] * value / before
        return changed

    def within(self, value: float) -> float:
        """Return the value, moved to the bound it is beyond."""
        return min(max(value, self.lower), self.upper)

    def column(self, values: Values) -> Column:
        """Return the direction in which the values change with this variable."""
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
        """Return values after a step in this variable's scale, within its bounds."""
        at = values[self.parameter]
        if self.logarithmic:
            return self.put(values, self.within(at * exp(min(max(step, -5.0), 5.0))))
        return self.put(values, self.within(at + step))

    def reach(self, values: Values, step: float) -> float:
        """Return how much the value changes by a small step in this variable's scale."""
        return step * values[self.parameter] if self.logarithmic else step


def nuisance_variable(nuisance: Nuisance) -> Variable:
    """Return the variable of a nuisance, bounded by its tolerance."""
    width = nuisance.tolerance * abs(nuisance.nominal)
    return Variable(
        nuisance.parameter, "", nuisance.parameter, nuisance.probe,
        nuisance.nominal - width, nuisance.nominal + width,
    )  # fmt: skip


def knob_variable(effect: Effect, knob: Knob) -> Variable:
    """Return the variable of an effect's knob."""
    return Variable(
        effect.name, knob.key, knob.parameter, knob.probe, knob.lower, knob.upper, knob.follows,
        knob.logarithmic,
    )  # fmt: skip


def effect_variables(effect: Effect) -> tuple[Variable, ...]:
    """Return the variables of an effect."""
    return tuple(knob_variable(effect, knob) for knob in effect.knobs)


def freed(variables: tuple[Variable, ...], effect: Effect) -> tuple[Variable, ...]:
    """Return the variables with those of an effect added; it takes the place of its nuisance."""
    added = effect_variables(effect)
    taken = {variable.parameter for variable in added}
    return (*(variable for variable in variables if variable.parameter not in taken), *added)


def started(
    plant: Plant, values: Values, effect: Effect, start: Mapping[str, float]
) -> dict[str, float]:
    """Return values with the knobs of an effect at a start."""
    changed = dict(values)
    for knob in effect.knobs:
        if knob.key in start:
            changed = knob_variable(effect, knob).put(changed, start[knob.key])
    return changed
