"""What the recordings held out say of each named effect."""

from typing import Final

from estimator.gap.prediction import Filtered, Fitter, Values, cost_of
from estimator.gap.search import CHANCE, Found, Refits, deviate

CONFIRMED: Final = 0.1
"""Part of what an effect would gain on held-out recordings, were it exact, that it must gain."""


def confirm(refits: Refits, found: Found, judged: Fitter) -> tuple[dict[str, float], list[str]]:
    """Drop named effects that do not lower the error held out.

    What an exact effect would gain there is the cost of what it changes in the predictions. Where
    that is below chance the motion held out tells nothing of the effect, and it is kept.

    Returns:
        normal deviates of the gains by effect, NaN where nothing is told; what was dropped, in
        words.
    """
    dropped: list[str] = []
    deviates: dict[str, float] = {}
    for named in list(found.named):
        held_out = judged.filtered(found.fitted.values)
        variables, without = refits.without(found, named.effect)
        expected = _changed(held_out, found.fitted.values, without.values)
        gains = held_out.costs(without.values) - held_out.costs(found.fitted.values)
        if expected < CHANCE:
            deviates[named.effect] = float("nan")
        elif gains.sum() < CONFIRMED * expected:
            found.named.remove(named)
            found.variables, found.fitted = variables, without
            dropped.append(
                f"{named.effect} explains the recordings that it was fitted to, but does not lower "
                "the error on those held out: it is not claimed"
            )
        else:
            deviates[named.effect] = deviate(gains)
    found.filtered = found.filtered.at(found.fitted.values)
    return deviates, dropped


def _changed(filtered: Filtered, values: Values, others: Values) -> float:
    """Return the cost of the change in innovations, summed over the blocks.

    Not its square: on a stop that the model has not, a few readings would outweigh all others.
    """
    total = 0.0
    both = zip(filtered.innovations(values), filtered.innovations(others), strict=True)
    for ((one, _), (other, _)), blocks in zip(both, filtered.blocks, strict=True):
        change = one - other
        for block in blocks:
            total += float(cost_of(change[block]).sum())
    return total
