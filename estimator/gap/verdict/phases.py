"""This module finds the phase of a tone in recordings held out, where nothing may be fitted to.

A tone begins each recording at another moment of its turn. What it does to a recording held out can
be predicted only once its phase is known there, so that this alone is taken from the beginning.
"""

from typing import Final

import numpy as np

from estimator.gap.plant import NOT_IN_FILES, Layout, in_files
from estimator.gap.prediction import Fitter, Values, Variable, settling
from estimator.gap.search import ADDED

_BEGINNING: Final = 4
"""The phase is taken from so many times as long as the filter takes to settle. Three blocks remain
after that, whose costs are compared."""
_STARTS: Final = 12
"""Number of phases from the best of which the fit starts: a twelfth of a turn leads to the best."""


def beginning(period: float) -> int:
    """Return the number of samples, of this period (s), from which a phase is taken.

    They last 2 s, and longer if samples are more than 25 ms apart.
    """
    return _BEGINNING * settling(period)


def has_tones(layout: Layout | None, values: Values) -> bool:
    """Return whether the values of all parameters hold a tone."""
    return layout is not None and any(a.form == "tone" for a in layout.additions(values))


def as_written(layout: Layout | None, values: Values) -> tuple[dict[str, float], list[str]]:
    """Return the values of all parameters as a model file can hold them, and what it cannot.

    The second result has the forms of the additions that are left out (`NOT_IN_FILES`). What is
    beyond a limit becomes a table.
    """
    if layout is None:
        return dict(values), []
    additions = layout.additions(values)
    kept = [in_files(each) for each in additions if each.form not in NOT_IN_FILES]
    left_out = [each.form for each in additions if each.form in NOT_IN_FILES]
    return {**values, **layout.values(kept)} if kept != additions else dict(values), left_out


def known_phases(values: Values, judged: Fitter) -> Values:
    """Return the values of all parameters with the phases of tones in recordings held out.

    Each phase is fitted alone to the beginning of its recording. Values without tones are returned
    as they are.

    Args:
        values: values of all parameters.
        judged: fitter of the recordings held out. Of each, the `beginning` is looked at.
    """
    layout = judged.predictor.plant.layout
    if layout is None or not has_tones(layout, values):
        return values
    found = dict(values)
    additions = layout.additions(values)
    end = beginning(judged.predictor.plant.period)
    for index, addition in enumerate(additions):
        if addition.form != "tone":
            continue
        names = layout.names(additions, index)[1][1:]
        for number in sorted({record.number for record in judged.records}):
            first = next(record for record in judged.records if record.number == number)
            begins = Fitter(judged.predictor, [first.part(0, end)], judged.pool)
            found[names[number]] = _phase(begins, found, names[number])
    return found


def _phase(begins: Fitter, values: Values, name: str) -> float:
    """Return the phase, rad, with which the beginning of a recording costs least.

    `name` is the parameter that holds the phase; all other `values` stay.
    """
    phases = 2.0 * np.pi * np.arange(1, _STARTS + 1) / _STARTS
    filtered = begins.filtered({**values, name: 0.0})
    costs = [float(filtered.costs({**values, name: float(phase)}).sum()) for phase in phases]
    start = float(phases[int(np.argmin(costs))])
    variable = Variable(name, name, 0.03, start - 10.0, start + 10.0, name=ADDED)
    fitted = filtered.fit({**values, name: start}, [variable], 4)
    return float(fitted.values[name])
