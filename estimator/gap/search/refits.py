"""Fits of a model with an effect more, or with one less."""

from collections.abc import Sequence
from typing import Final

from estimator.gap.prediction import (
    Changes,
    Filtered,
    Fitted,
    Fitter,
    Values,
    Variable,
    effect_variables,
    freed,
    nuisance_variable,
    started,
)

from .findings import Found, Screened

_ROUNDS: Final = 5
"""How often, at most, the gains are computed anew for the values, and the values for the gains."""
_SETTLED: Final = 1e-3
"""A step that lowers the cost by a smaller part than this ends the rounds."""


class Refits:
    """Fits a model to the records of a fitter, with its plant's nuisances and some effects.

    Args:
        fitter: of the records.
    """

    def __init__(self, fitter: Fitter) -> None:
        self.fitter = fitter
        self.plant = fitter.predictor.plant
        self.nuisances = tuple(nuisance_variable(n) for n in self.plant.nuisances)

    def settled(self, values: Values, variables: Sequence[Variable]) -> tuple[Fitted, Filtered]:
        """Return the fit of variables whose gains are its own, from values on, and these gains."""
        for _ in range(_ROUNDS):
            filtered = self.fitter.filtered(values)
            before = filtered.costs(values).sum()
            fitted = filtered.fit(values, variables, 4)
            values = fitted.values
            # Where the values hardly moved, their gains did not either.
            if before - fitted.cost < _SETTLED * fitted.cost:
                break
        return fitted, filtered

    def with_effect(
        self, filtered: Filtered, values: Values, variables: Sequence[Variable],
        candidate: Screened,
    ) -> Fitted:  # fmt: skip
        """Return the fit with a candidate added, with given gains.

        Args:
            filtered: the records with these gains, such as those of the fit without it.
            values: of the fit without it.
            variables: of that fit.
            candidate: to be added.
        """
        effect = self.plant.effects[candidate.effect]
        start = started(self.plant, values, effect, candidate.start)
        kept = _changes_by_name(filtered, values, variables)
        first = {}
        # What the screening has run side by side already, and at no other start.
        if start == values:
            first = _changes_by_name(filtered, values, (*variables, *effect_variables(effect)))
        return filtered.fit(start, freed(tuple(variables), effect), 5, 3e-4, kept, first)

    def with_own_gains(
        self, filtered: Filtered, values: Values, variables: Sequence[Variable],
        candidate: Screened,
    ) -> Fitted:  # fmt: skip
        """Return, as `with_effect`, a fit whose gains are its own.

        With those of a model without it, a large effect of a valve's edges hardly gains at all.
        """
        fitted = self.with_effect(filtered, values, variables, candidate)
        effect = self.plant.effects[candidate.effect]
        return self.settled(fitted.values, freed(tuple(variables), effect))[0]

    def without(
        self, found: Found, name: str, exact: bool = False
    ) -> tuple[tuple[Variable, ...], Fitted]:
        """Return variables and fit without an effect, with the gains of the finding."""
        kept = [v for v in found.variables if not (v.name == name and v.key)]
        values = dict(found.fitted.values)
        for variable in effect_variables(self.plant.effects[name]):
            values = variable.put(values, self.plant.nominal[variable.parameter])
        refitted = found.refitted.values
        present = {variable.parameter for variable in kept}
        back = [v for v in self.nuisances if v.parameter not in present]
        back = [v for v in back if v.parameter in {w.parameter for w in found.variables}]
        variables = (*back, *kept)
        # The nuisances may have to go far: from where they are now, or from where they once were.
        once = {**values, **{v.parameter: refitted[v.parameter] for v in variables if not v.key}}
        filtered = found.filtered
        if filtered.costs(once).sum() < filtered.costs(values).sum():
            values = once
        changes = None if exact else _changes_by_name(filtered, found.fitted.values, kept)
        return variables, filtered.fit(values, variables, 6, 3e-4, changes)


def _changes_by_name(
    filtered: Filtered, values: Values, variables: Sequence[Variable]
) -> dict[str, Changes]:
    """Return the changes by variables at values, by the names of their columns."""
    columns = filtered.columns(values, variables)
    changes = filtered.changes(values, columns)
    return {column.name: change for column, change in zip(columns, changes, strict=True)}
