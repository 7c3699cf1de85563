"""This module chooses between effects of the catalogue and disturbances that were discovered.

There are three answers: the named effects, the disturbances alone, or both together. Chosen is what
predicts the recordings fitted to better, block by block and beyond chance, at the least number of
parts. Disturbances are free curves, and explain much in the likeness of an effect. So an effect
that explains four fifths of the excess keeps its name, unless disturbances alone predict better and
are not a curve of the effect's own variable. So do effects that explain four fifths of what such a
curve does, where that explains four fifths of the excess.
"""

from dataclasses import dataclass
from typing import Final

from estimator.gap.plant import Plant
from estimator.gap.search import FORM, DiscoveredModel, Discovering, Discovery, Found

from .own_form import EXPLAINED, OwnForm, beats, by_formula, by_likeness, in_place_of_several

SETTLED: Final = 0.1
"""Greatest excess, in variances per reading, that named effects may leave without a look at what
else may be missing: ten times what matters."""
WHOLE: Final = 0.98
"""Part of the excess that disturbances alone must take away for the named effects to be given up
before both are tried together."""
BEYOND: Final = 0.05
"""Least part of the excess by which one answer must be better than another of no more parts."""
HALF: Final = 0.5
"""Least part of what an answer leaves that one of fewer parts must take away to be better."""
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
    given = DiscoveredModel(found.fitted, found.filtered, found.variables)
    pinned = _pinned(plant, found)
    one = in_place_of_several(discovering, found, pinned)
    if one is not None:
        _take(found, one)
        pinned = _pinned(plant, found)
    names = one.corrected if one is not None and one.corrected is not None else given
    left = names.fitted.cost - floor * found.samples
    settled = left < min(FORM * excess, SETTLED * found.samples) and not pinned
    if left < material * found.samples or (found.named and settled):
        return Choice(names, bool(found.named), *_divided(plant, found, names))
    alone = discovering.run(found.refitted, discovering.nuisances, floor)
    nothing_named = Choice(alone, False, {}, tuple(alone.discoveries))
    own = None
    if not found.named or found.explained < EXPLAINED:
        own = by_formula(discovering, found, alone)
        if own is not None:
            _take(found, own)
    parts = len(found.named) + len(names.discoveries)
    least = BEYOND * excess if parts <= len(alone.discoveries) else HALF * left
    better = bool(alone.discoveries) and beats(alone.fitted.costs, names.fitted.costs, least)
    stands_in = pinned or (better and own is None and not _is_own(plant, found, alone))
    left_alone = alone.fitted.cost - floor * found.samples
    if not found.named or (better and stands_in and left_alone < (1.0 - WHOLE) * excess):
        return _by_its_curve(discovering, found, alone) or nothing_named
    beside = discovering.run(found.fitted, found.variables, floor)
    both = Choice(beside, True, *_divided(plant, found, beside))
    doubted = bool(pinned) or stands_in
    told = found.explained >= EXPLAINED or _is_formula_of(plant, found, alone, excess)
    if own is None and (doubted or not told):
        # Names that are in doubt stand where without them half of the rest more would be left.
        least = HALF * left_alone if pinned or not stands_in else BEYOND * excess
        if not beats(beside.fitted.costs, alone.fitted.costs, max(least, BEYOND * excess)):
            return _by_its_curve(discovering, found, alone) or nothing_named
    return both


def _take(found: Found, one: OwnForm) -> None:
    """Set one effect as all that is named, and its fit, in the finding."""
    found.named, found.fitted, found.variables = [one.named], one.fitted, one.variables


def _by_its_curve(discovering: Discovering, found: Found, alone: DiscoveredModel) -> Choice | None:
    """Return the choice of an effect whose curve was discovered; None if there is none."""
    own = by_likeness(discovering, found, alone)
    if own is None or own.corrected is None:
        return None
    _take(found, own)
    first, *others = own.corrected.discoveries
    return Choice(own.corrected, True, {own.named.effect: first}, tuple(others))


def _pinned(plant: Plant, found: Found) -> set[str]:
    """Return the named effects whose size is at an end of what is plausible.

    A fit would move such a size (`PINNED`) beyond the end, so that the effect stands in for
    something else. The size is the effect's first knob; an end at which it was in the model as
    given does not count.
    """
    names: set[str] = set()
    for named in found.named:
        knob = plant.effects[named.effect].knobs[0]
        value, given = (f.values[knob.parameter] for f in (found.fitted, found.given))
        near = PINNED * (knob.upper - knob.lower)
        ends = [end for end in (knob.lower, knob.upper) if abs(end - given) > near]
        if any(abs(value - end) <= near for end in ends):
            names.add(named.effect)
    return names


def _is_own(plant: Plant, found: Found, alone: DiscoveredModel) -> bool:
    """Return whether what was discovered alone begins with a named effect's own curve."""
    if not alone.discoveries:
        return False
    first = alone.discoveries[0]
    where = (first.addition.place, first.addition.of)
    return any(where in plant.effects[named.effect].own for named in found.named)


def _is_formula_of(plant: Plant, found: Found, alone: DiscoveredModel, excess: float) -> bool:
    """Return whether what was discovered alone is, for the most part, the named effects' formula.

    It begins with an effect's own curve and explains `EXPLAINED` of the excess, and the formulas
    explain `EXPLAINED` of what it does. What neither explains then says nothing against the names.
    """
    by_curves = found.refitted.cost - alone.fitted.cost
    by_formulas = found.refitted.cost - found.fitted.cost
    if by_curves < EXPLAINED * excess or by_formulas < EXPLAINED * by_curves:
        return False
    return _is_own(plant, found, alone)


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
