"""This module chooses between effects of the catalogue and disturbances that were discovered.

There are three answers: the named effects, the disturbances alone, or both together. Chosen is what
predicts the recordings fitted to better, block by block and beyond chance, at the least number of
parts. Disturbances are free curves, and explain much in the likeness of an effect. So an effect
that explains four fifths of the excess keeps its name, unless disturbances alone predict better and
are not a curve of the effect's own variable.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant
from estimator.gap.prediction import Fitted, Variable
from estimator.gap.search import (
    CHANCE,
    FORM,
    DiscoveredModel,
    Discovering,
    Discovery,
    Found,
    Named,
    deviate,
)

EXPLAINED: Final = 0.8
"""Part of the excess in prediction error that named effects must take away to keep their names."""
WHOLE: Final = 0.98
"""Part of the excess that disturbances alone must take away for the named effects to be given up
before both are tried together."""
BEYOND: Final = 0.05
"""Least part of the excess by which one answer must be better than another."""
SURE: Final = 2.0
"""Least normal deviate of the difference between two answers, by the scatter of the blocks."""
PINNED: Final = 1e-3
"""Part of a size's plausible range. A size that is nearer than this to an end of the range counts
as being at that end. This bound was chosen: it is far less than the errors of fitted sizes."""


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
    excess = found.refitted.cost - floor * found.samples
    left = found.fitted.cost - floor * found.samples
    nothing = DiscoveredModel(found.fitted, found.filtered, found.variables)
    pinned = _pinned(plant, found)
    settled = bool(found.named) and left < FORM * excess and not pinned
    if left < material * found.samples or settled:
        return Choice(nothing, bool(found.named), {}, ())
    alone = discovering.run(found.refitted, discovering.nuisances, floor)
    weak = not found.named or found.explained < EXPLAINED
    own = _own_effect(discovering, found, alone, excess) if weak else None
    if own is not None:
        found.named, found.fitted, found.variables = [own.named], own.fitted, own.variables
    elif not found.named:
        return Choice(alone, False, {}, tuple(alone.discoveries))
    better = bool(alone.discoveries) and _beats(alone.fitted.costs, found.fitted.costs, excess)
    stands_in = pinned or (better and own is None and not _is_own(plant, found, alone))
    left_alone = alone.fitted.cost - floor * found.samples
    if better and stands_in and left_alone < (1.0 - WHOLE) * excess:
        return Choice(alone, False, {}, tuple(alone.discoveries))
    beside = discovering.run(found.fitted, found.variables, floor)
    corrections, others = _divided(plant, found, beside)
    together = _beats(beside.fitted.costs, alone.fitted.costs, excess)
    if own is not None or found.explained >= EXPLAINED:
        if alone.discoveries and (pinned or (stands_in and not together)):
            return Choice(alone, False, {}, tuple(alone.discoveries))
        return Choice(beside, True, corrections, others)
    gained = alone.fitted.cost - beside.fitted.cost
    if together and beside.discoveries and gained > EXPLAINED * left_alone:
        return Choice(beside, True, corrections, others)
    return Choice(alone, False, {}, tuple(alone.discoveries))


@dataclass(frozen=True)
class _Own:
    """An effect of the catalogue whose formula is a curve where a disturbance was discovered."""

    named: Named
    fitted: Fitted
    variables: tuple[Variable, ...]


def _own_effect(
    discovering: Discovering, found: Found, alone: DiscoveredModel, excess: float
) -> _Own | None:
    """Return the effect to which the first disturbance belongs; None if there is none.

    An effect is named by where it enters and against what. Of those whose own curve was discovered,
    the one that explains most keeps its name if it explains `EXPLAINED` of the excess by itself.
    There is none either where a single effect of these was named before.
    """
    if not alone.discoveries or excess <= 0.0:
        return None
    first = alone.discoveries[0]
    where = (first.addition.place, first.addition.of)
    effects = [each for each in discovering.plant.effects.values() if where in each.own]
    names = {named.effect for named in found.named}
    if len(names) == 1 and names <= {each.name for each in effects}:
        return None
    best: _Own | None = None
    for effect in effects:
        fitted, variables = discovering.with_effect(found.refitted.values, effect)
        if fitted is None or (best is not None and fitted.cost >= best.fitted.cost):
            continue
        gains = found.refitted.costs - fitted.costs
        gain = float(gains.sum())
        named = Named(effect.name, gain, gain / found.samples, CHANCE, deviate(gains))
        best = _Own(named, fitted, variables)
    if best is None or best.named.gain < EXPLAINED * excess:
        return None
    return best


def _pinned(plant: Plant, found: Found) -> bool:
    """Return whether the size of a named effect is at an end of what is plausible.

    A fit would move such a size (`PINNED`) beyond the end, so that the effect stands in for
    something else. The size is the effect's first knob; an end at which it was in the model as
    given does not count.
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
    where = (first.addition.place, first.addition.of)
    return any(where in plant.effects[named.effect].own for named in found.named)


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
