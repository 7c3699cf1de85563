"""This module tells how surely each named effect lowers the error on the held-out recordings."""

from estimator.gap.prediction import Filtered, Fitter, Values, cost_of
from estimator.gap.search import CHANCE, Found, Refits, deviate


def held_out_deviates(refits: Refits, found: Found, judged: Fitter) -> dict[str, float]:
    """Return for each named effect the normal deviate of its gain on the held-out recordings.

    It is only reported: nothing is decided by it. Where what the effect changes in the predictions
    costs less than `CHANCE`, the held-out motion shows nothing of the effect, and the deviate is
    NaN. `judged` is the fitter of the held-out records.
    """
    deviates: dict[str, float] = {}
    for named in found.named:
        held_out = judged.filtered(found.fitted.values)
        if named.read is None:
            _, without = refits.without(found, named.effect)
        else:
            without = found.refitted
        expected = _changed(held_out, found.fitted.values, without.values)
        gains = held_out.costs(without.values) - held_out.costs(found.fitted.values)
        deviates[named.effect] = float("nan") if expected < CHANCE else deviate(gains)
    return deviates


def _changed(filtered: Filtered, values: Values, others: Values) -> float:
    """Return the cost of the change in innovations from one set of values to the other.

    It is summed over the blocks. It is not the square of the change: on a stop that the model
    lacks, a few readings would then outweigh all others.
    """
    total = 0.0
    both = zip(filtered.innovations(values), filtered.innovations(others), strict=True)
    for ((one, _), (other, _)), blocks in zip(both, filtered.blocks, strict=True):
        change = one - other
        for block in blocks:
            total += float(cost_of(change[block]).sum())
    return total
