"""This module says how sure the fitted values of a finding are: their standard errors."""

from typing import Final

import numpy as np

from estimator.gap.search import ADDED, ENDLESS, Found, Search

_FORM: Final = 5e-3
"""Part of an effect's size that is added to its standard error. The rig never has exactly the form
of the model and its effects, which the scatter of the recordings does not show. Twice this part is
1 %."""


def standard_errors(search: Search, found: Found) -> dict[str, float]:
    """Return the standard error of each variable's parameter, SI, by the parameter's name.

    It is the larger of two: one from the scatter of the blocks' scores, the other from how wrong
    the parameters of twins, which are known, are estimated. A variable that is held beside a
    disturbance has the error that it has without.
    """
    columns = found.filtered.columns(found.fitted.values, found.variables)
    names = [column.name for column in columns]
    linear = found.filtered.linearise(found.fitted.values, columns)
    held = np.array([variable.is_held for variable in found.variables])
    added = np.array([variable.name == ADDED for variable in found.variables])
    errors = np.zeros(len(names))
    for these, told in ((~held, ~held), (~added, held & ~added)):
        among = [name for name, one in zip(names, these, strict=True) if one]
        if told.any():
            errors[told] = linear.errors(among, linear.solve(among)[0])[told[these]]
    misses = []
    for twin in search.twins.of(found.fitted.values, 3):
        misses.append(twin.linearise(found.fitted.values, columns).solve(names)[0])
    wrong = np.sqrt(np.mean(np.square(misses), axis=0))
    return {
        variable.parameter: variable.reach(found.fitted.values, float(max(error, miss)))
        for variable, error, miss in zip(found.variables, errors, wrong, strict=True)
    }


def form_error(value: float, before: float) -> float:
    """Return the standard error, SI, of an effect's parameter that comes from the effect's form.

    It is 0.5 % of the size of the effect.

    Args:
        value: fitted value, SI.
        before: value in the model as given, SI. If it is more than `ENDLESS` times `value`, and
            `value` is not 0, the effect is a limit that had no effect before, and its size is
            `value` itself; else the size is the difference.
    """
    size = value if abs(before) > ENDLESS * abs(value) > 0.0 else value - before
    return _FORM * abs(size)
