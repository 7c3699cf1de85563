"""This module tells which variables of a fit a disturbance may stand in for."""

from typing import Final

from estimator.gap.plant import Plant
from estimator.gap.prediction import Filtered, Values, Variable

from .explaining import Explanation

ADDED: Final = "added"
"""Name of the variables of additions."""
STANDS_IN: Final = 3.0
"""A disturbance may stand in for a variable whose standard error it makes larger by this factor:
eight ninths of what the recordings show of the variable, it does as well."""
VAGUE: Final = 0.25
"""Part of a nuisance's range. A nuisance with a larger standard error is not known any more."""


def stood_in_for(
    each: Explanation,
    plant: Plant,
    filtered: Filtered,
    values: Values,
    base: tuple[Variable, ...],
    own: tuple[Variable, ...],
) -> set[Variable]:
    """Return the variables that an explanation fitted with them may stand in for.

    Such a variable has a standard error more than `STANDS_IN` times as large with the explanation
    as without it. It also belongs to an earlier disturbance, or it is a knob of an effect whose own
    curve the explanation is, or a nuisance. A nuisance counts only if the explanation is a table,
    which can take any form, or if the nuisance is not known any more (`VAGUE`).

    Args:
        each: the explanation.
        plant: plant that it is in.
        filtered: the records, with gains for `values`.
        values: values of all parameters, fitted with the explanation.
        base: variables that were fitted with it.
        own: variables of the explanation itself.
    """
    columns = filtered.columns(values, (*base, *own))
    linear = filtered.linearise(values, columns)
    errors = []
    for variables in (base, (*base, *own)):
        names = [column.name for column in columns[: len(variables)]]
        errors.append(linear.errors(names, linear.solve(names)[0])[: len(base)])
    found = set()
    for variable, without, beside in zip(base, *errors, strict=True):
        if variable.is_held or not beside > STANDS_IN * without:
            continue
        if variable.name == ADDED:
            vague = True
        elif variable.key:
            vague = each.where[:2] in plant.effects[variable.name].own
        else:
            reach = abs(variable.reach(values, float(beside)))
            vague = reach > VAGUE * (variable.upper - variable.lower)
            vague |= each.shape.form == "table"
        if vague:
            found.add(variable)
    return found
