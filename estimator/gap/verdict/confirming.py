"""This module checks whether each named effect lowers the error on the held-out recordings."""

from typing import Final

from estimator.gap.prediction import Filtered, Fitter, Values, cost_of
from estimator.gap.search import CHANCE, Found, Refits, deviate

CONFIRMED: Final = 0.1
"""Least gain of an effect on the held-out recordings, as a part of what it would gain there if it
were exact."""


def confirm(refits: Refits, found: Found, judged: Fitter) -> tuple[dict[str, float], list[str]]:
    """Remove effects from the finding that hardly lower the cost of the held-out recordings.

    What an exact effect would gain there is the cost of what it changes in the predictions. An
    effect that gains less than a tenth of that (`CONFIRMED`) is removed, and the finding refitted
    in place. Where the exact gain is below `CHANCE`, the held-out motion shows nothing of the
    effect, and the effect stays. `judged` is the fitter of the held-out records.

    Returns:
        For each effect that stays, the normal deviate of its held-out gain, NaN where the motion
        shows nothing; and in words, which effects were removed.
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
