"""This module tells how much of what is left, held out, other values of the nuisances would take.

Friction is not the same from run to run. A model that is fitted to some recordings cannot predict
that of others, whatever it holds.
"""

from typing import Final

from estimator.gap.prediction import Fitter, Values, channel_gaps, mean_gap
from estimator.gap.search import Refits

LEAST: Final = 0.1
"""Least gap, in noise variances, that is looked into: ten times what matters to a prediction."""
PART: Final = 0.05
"""Part of the gap of the model as given that the model written must leave to be looked into, and
part of what is left that the refit must take away to be told."""
_MOVED: Final = 2e-3
"""Part of its value that a nuisance must move to be told."""


def changed_since(judged: Fitter, values: Values, gap: tuple[float, float]) -> list[str]:
    """Return a list with one remark in words, on nuisances that differ in the held-out recordings.

    The nuisances are refitted to the held-out recordings, for this remark alone: neither the gap
    nor the model written gets anything of it. Without a change that matters the list is empty.

    Args:
        judged: fitter of the held-out recordings.
        values: values of all parameters in the model written.
        gap: gap held out, before and after, in noise variances.
    """
    before, left = gap
    if not left > max(LEAST, PART * before):
        return []
    refits = Refits(judged)
    refitted = refits.settled(values, refits.nuisances)[0].values
    still = mean_gap(channel_gaps(judged.predictor, judged.records, values, refitted, judged.pool))[
        1
    ]
    if not left - still > PART * left:
        return []
    names = [variable.parameter for variable in refits.nuisances]
    moved = {name: refitted[name] / values[name] - 1.0 for name in names if values[name]}
    told = ", ".join(
        f"{name} {abs(change):.1%} {'more' if change > 0.0 else 'less'}"
        for name, change in moved.items()
        if abs(change) > _MOVED
    )
    if not told:
        return []
    return [
        f"of the {left:.3g} noise variances left on the recordings held out, {left - still:.2g} "
        f"would go with nuisances refitted to these alone ({told}): the machine was not quite the "
        "same there, or the model errs otherwise in that motion"
    ]
