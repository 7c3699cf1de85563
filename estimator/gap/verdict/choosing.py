"""This module chooses between effects of the catalogue and disturbances that were discovered.

There are three answers: the named effects, the disturbances alone, or both together. Chosen is what
predicts the recordings fitted to better, block by block and beyond chance, at the least number of
parts. Disturbances are free curves, and explain much in the likeness of an effect. So an effect that
explains four fifths of the excess keeps its name, unless disturbances alone predict better, and
neither of them is a curve of the effect's own variable.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant
from estimator.gap.search import DiscoveredModel, Discovering, Discovery, Found

EXPLAINED: Final = 0.8
"""Part of the excess in prediction error that named effects must take away to keep their names."""
WHOLE: Final = 0.98
"""Part of the excess above which there is nothing left to discover: twice the part by which the
form of an effect may be wrong."""
BEYOND: Final = 0.05
"""Least part of the excess by which one answer must be better than another."""
PINNED: Final = 1e-3
"""Part of a size's plausible range. A size that is nearer than this to an end of the range counts
as being at that end. This bound was chosen: it is far less than the errors of fitted sizes."""
SURE: Final = 2.0
"""Least normal deviate of that difference, by the scatter of the blocks."""


@dataclass(frozen=True)
class Choice:
    """The answer that was chosen.

    Attributes:
        model: model with all that is claimed.
        named: whether the effects of the catalogue are a part of it.
        corrections: for the name of an effect, the disturbance that corrects its formula.
        discovered: the other disturbances, in the order in which they were found.
    """

    model: DiscoveredModel
    named: bool
    corrections: dict[str, Discovery]
    discovered: tuple[Discovery, ...]


def choose(discovering: Discovering, found: Found, material: float) -> Choice:
    """Return the answer to what a search found, with what is discovered beside or in its place.

    Args:
        discovering: discovers disturbances in the records of the search.
        found: finding of the search, with its floor.
        material: least excess, in variances per reading, that is looked into.
    """
    plant, floor = discovering.plant, found.floor
    left = found.fitted.cost / found.samples - floor
    nothing = DiscoveredModel(found.fitted, found.filtered, found.variables)
    if left < material or (found.named and found.explained > WHOLE):
        return Choice(nothing, bool(found.named), {}, ())
    beside = discovering.run(found.fitted, found.variables, floor)
    if not found.named:
        return Choice(beside, False, {}, tuple(beside.discoveries))
    pinned = _pinned(plant, found)
    nuisances = discovering.nuisances
    alone = discovering.run(found.refitted, nuisances, floor)
    excess = found.refitted.cost - floor * found.samples
    corrections, others = _divided(plant, found, beside)
    if found.explained >= EXPLAINED:
        stands_in = _beats(alone.fitted.costs, found.fitted.costs, excess) and not _beats(
            beside.fitted.costs, alone.fitted.costs, excess
        )
        if alone.discoveries and (pinned or (stands_in and not _is_own(plant, found, alone))):
            return Choice(alone, False, {}, tuple(alone.discoveries))
        return Choice(beside, True, corrections, others)
    left_alone = alone.fitted.cost - floor * found.samples
    gained = alone.fitted.cost - beside.fitted.cost
    together = _beats(beside.fitted.costs, alone.fitted.costs, excess)
    if together and beside.discoveries and gained > EXPLAINED * left_alone:
        return Choice(beside, True, corrections, others)
    return Choice(alone, False, {}, tuple(alone.discoveries))


def _pinned(plant: Plant, found: Found) -> bool:
    """Return whether the size of a named effect is at an end of what is plausible.

    A fit would move such a size (`PINNED`) beyond the end, so that the effect stands in for
    something else. The size is the effect's first knob; an end at which it was in the model as given
    does not count.
    """
    for named in found.named:
        knob = plant.effects[named.effect].knobs[0]
        value, given = (f.values[knob.parameter] for f in (found.fitted, found.given))
        near = PINNED * (knob.upper - knob.lower)
        ends = [end for end in (knob.lower, knob.upper) if abs(end - given) > near]
        if any(abs(value - end) <= near for end in ends):
            return True
    return False


def _beats(one: Array, other: Array, excess: float) -> bool:
    """Return whether block costs `one` are less than `other`, by `BEYOND` and beyond chance."""
    gains = other - one
    error = float(np.sqrt(len(gains)) * np.std(gains, ddof=1))
    return float(gains.sum()) > max(BEYOND * excess, SURE * error)


def _is_own(plant: Plant, found: Found, alone: DiscoveredModel) -> bool:
    """Return whether what was discovered alone begins with a named effect's own curve."""
    if not alone.discoveries:
        return False
    first = alone.discoveries[0]
    places = {(first.addition.place, first.addition.of)}
    places |= {each.where[:2] for each in first.rivals}
    return any(places & set(plant.effects[named.effect].own) for named in found.named)


def _divided(
    plant: Plant, found: Found, model: DiscoveredModel
) -> tuple[dict[str, Discovery], tuple[Discovery, ...]]:
    """Return which disturbances correct a named effect, by its name, and the others."""
    corrections: dict[str, Discovery] = {}
    others: list[Discovery] = []
    for each in model.discoveries:
        where = (each.addition.place, each.addition.of)
        near = {where, *(rival.where[:2] for rival in each.rivals)}
        names = [n.effect for n in found.named if near & set(plant.effects[n.effect].own)]
        name = next((name for name in names if name not in corrections), None)
        if name is None:
            others.append(each)
        else:
            corrections[name] = each
    return corrections, tuple(others)
