"""This module fits a model with one effect more, or with one effect less."""

from collections.abc import Mapping, Sequence
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
"""Greatest number of rounds; in each, gains are computed for the values, and values are fitted with
these gains."""
SETTLED_BY: Final = 1e-3
"""The rounds end when one lowers the cost by a smaller part than this."""


class Refits:
    """Fits a model to the records of a fitter, with its plant's nuisances and some effects.

    In its methods "gains" are those of the filter.

    Args:
        fitter: fitter of the records.
    """

    def __init__(self, fitter: Fitter) -> None:
        self.fitter = fitter
        self.plant = fitter.predictor.plant
        self.nuisances = tuple(nuisance_variable(n) for n in self.plant.nuisances)

    def settled(
        self, values: Values, variables: Sequence[Variable], rounds: int = _ROUNDS
    ) -> tuple[Fitted, Filtered]:
        """Return a fit whose gains nearly belong to its own values, and the records with its gains.

        Starting from `values`, gains are computed and variables fitted in turn, at most `rounds`
        times, until the cost falls by less than 0.1 %. The gains belong to the values from which
        the last round started.
        """
        for _ in range(rounds):
            filtered = self.fitter.filtered(values)
            fitted = filtered.fit(values, variables, 4)
            values = fitted.values
            # If the values hardly moved, their gains did not change either.
            if fitted.before - fitted.cost < SETTLED_BY * fitted.cost:
                break
        return fitted, filtered

    def by_chords(
        self,
        values: Values,
        variables: tuple[Variable, ...],
        rounds: int,
        kept: Mapping[str, Changes] | None = None,
        exact: bool = False,
    ) -> tuple[Fitted, Filtered, Mapping[str, Changes]]:
        """Return a fit after rounds of computing gains and fitting, and the records with it.

        The rounds end early when one lowers the cost by less than the part `SETTLED_BY` of it. The
        gains of the result are those of the fit's own values. The changes by the variables are
        computed at the start and after the first step, and kept from then on (chord method): a
        table has a column for each knot, and to run the plant for each takes most of the time.

        Args:
            values: values of all parameters at the start.
            variables: parameters to fit.
            rounds: greatest number of rounds.
            kept: changes by column name that are used from the start; None to compute them.
            exact: whether they are computed anew in each round, as what the place of
                a corner, or the width of a play, changes depends on that itself.

        Returns:
            The fit, the records with its gains, and the changes that were kept.
        """
        for _ in range(rounds):
            filtered = self.fitter.filtered(values)
            before = float(filtered.costs(values).sum())
            if kept is None or exact:
                values = filtered.fit(values, variables, 1, 3e-3).values
                kept = changes_by_name(filtered, values, variables)
            fitted = filtered.fit(values, variables, 2, 3e-3, kept)
            values = fitted.values
            if before - fitted.cost < SETTLED_BY * fitted.cost:
                break
        filtered = self.fitter.filtered(values)
        return Fitted(dict(values), filtered.costs(values)), filtered, kept or {}

    def with_effect(
        self, filtered: Filtered, values: Values, variables: Sequence[Variable],
        candidate: Screened,
    ) -> Fitted:  # fmt: skip
        """Return the fit after a candidate is added, with given gains.

        Args:
            filtered: the records with these gains, such as those of the fit without the candidate.
            values: values of all parameters in the fit without the candidate.
            variables: variables of that fit.
            candidate: effect to be added.
        """
        effect = self.plant.effects[candidate.effect]
        start = started(self.plant, values, effect, candidate.start)
        kept = changes_by_name(filtered, values, variables)
        first: dict[str, Changes] | None = None
        # At this start, and at no other, the screening has already run these changes side by side.
        if start == values:
            first = changes_by_name(filtered, values, (*variables, *effect_variables(effect)))
        return filtered.fit(start, freed(tuple(variables), effect), 5, 3e-4, kept, first)

    def with_own_gains(
        self, filtered: Filtered, values: Values, variables: Sequence[Variable],
        candidate: Screened,
    ) -> Fitted:  # fmt: skip
        """Return the fit after a candidate is added, with gains that belong to its own values.

        With the gains of a model without it, a large effect of a valve's edges hardly gains at all.
        """
        fitted = self.with_effect(filtered, values, variables, candidate)
        effect = self.plant.effects[candidate.effect]
        return self.settled(fitted.values, freed(tuple(variables), effect))[0]

    def without(
        self, found: Found, name: str, exact: bool = False
    ) -> tuple[tuple[Variable, ...], Fitted]:
        """Return the variables and the fit without a named effect, with the gains of the finding.

        The effect's parameters are as in the model given. The finding itself is not changed. The
        nuisances that the effect took the place of are fitted again. With `exact`, the changes
        of all columns are computed anew in each step; otherwise those of the finding are used
        again.
        """
        kept = [v for v in found.variables if not (v.name == name and v.key)]
        values = dict(found.fitted.values)
        for variable in effect_variables(self.plant.effects[name]):
            values = variable.put(values, self.plant.nominal[variable.parameter])
        refitted = found.refitted.values
        present = {variable.parameter for variable in kept}
        back = [v for v in self.nuisances if v.parameter not in present]
        back = [v for v in back if v.parameter in {w.parameter for w in found.variables}]
        variables = (*back, *kept)
        # The nuisances may have to move far. So the fit starts from their present values or from
        # those before any effect was added, whichever cost less.
        once = {**values, **{v.parameter: refitted[v.parameter] for v in variables if not v.key}}
        filtered = found.filtered
        if filtered.costs(once).sum() < filtered.costs(values).sum():
            values = once
        changes = None if exact else changes_by_name(filtered, found.fitted.values, kept)
        return variables, filtered.fit(values, variables, 6, 3e-4, changes)


def changes_by_name(
    filtered: Filtered, values: Values, variables: Sequence[Variable]
) -> dict[str, Changes]:
    """Return the changes of the innovations by each variable at `values`, by column name."""
    columns = filtered.columns(values, variables)
    changes = filtered.changes(values, columns)
    return {column.name: change for column, change in zip(columns, changes, strict=True)}
