"""Fits of a model with an effect more, or with one less."""

from collections.abc import Sequence
from typing import Final

from estimator.gap.prediction import (
    Changes,
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
        fitter: of the records; what it is filtered with gives the gains.
    """

    def __init__(self, fitter: Fitter) -> None:
        self.fitter = fitter
        self.plant = fitter.predictor.plant
        self.nuisances = tuple(nuisance_variable(n) for n in self.plant.nuisances)

    def settled(self, fitted: Fitted, variables: Sequence[Variable]) -> Fitted:
        """Return the fit of variables whose gains are its own."""
        for _ in range(_ROUNDS):
            self.fitter.refresh(fitted.values)
            before = self.fitter.costs(fitted.values).sum()
            fitted = self.fitter.fit(fitted.values, variables, 4)
            # Where the values hardly moved, their gains did not either.
            if before - fitted.cost < _SETTLED * fitted.cost:
                break
        return fitted

    def with_effect(
        self, present: Fitted, variables: Sequence[Variable], candidate: Screened
    ) -> Fitted:
        """Return the fit with a candidate added, with the gains of the fit without it."""
        effect = self.plant.effects[candidate.effect]
        values = started(self.plant, present.values, effect, candidate.start)
        kept = self._kept(present.values, variables)
        return self.fitter.fit(values, freed(tuple(variables), effect), 5, 3e-4, kept)

    def with_own_gains(
        self, present: Fitted, variables: Sequence[Variable], candidate: Screened
    ) -> Fitted:
        """Return the fit with a candidate added, whose gains are its own.

        With those of a model without it, a large effect of a valve's edges hardly gains at all.
        """
        fitted = self.with_effect(present, variables, candidate)
        effect = self.plant.effects[candidate.effect]
        fitted = self.settled(fitted, freed(tuple(variables), effect))
        self.fitter.refresh(present.values)
        return fitted

    def without(
        self, found: Found, name: str, exact: bool = False
    ) -> tuple[tuple[Variable, ...], Fitted]:
        """Return variables and fit without an effect, with the gains of the fit with it."""
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
        if self.fitter.costs(once).sum() < self.fitter.costs(values).sum():
            values = once
        changes = None if exact else self._kept(found.fitted.values, kept)
        return variables, self.fitter.fit(values, variables, 6, 3e-4, changes)

    def _kept(self, values: Values, variables: Sequence[Variable]) -> dict[str, Changes]:
        """Return the changes by variables, by the names of their columns."""
        columns = self.fitter.columns(values, variables)
        changes = self.fitter.changes(values, columns)
        return {column.name: change for column, change in zip(columns, changes, strict=True)}
