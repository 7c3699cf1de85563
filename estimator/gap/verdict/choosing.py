"""This module chooses between effects of the catalogue and disturbances that were discovered.

There are three answers: the named effects, the disturbances alone, or both together. Chosen is what
predicts the recordings fitted to better, block by block and beyond chance, at the least number of
parts. Disturbances are free curves, and explain much in the likeness of an effect. So an effect
that explains four fifths of the excess keeps its name, unless disturbances alone predict better and
are not a curve of the effect's own variable. So do effects that explain four fifths of what such a
curve does, where that explains four fifths of the excess.

An effect is named by where it enters, against what, and in which regime; its formula is a first
guess. A disturbance that was discovered in an effect's own place, against its own quantity, is that
effect with another form, if the effect's formula explains most of the excess, or if the curve runs
as the effect does.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import KNOTS, MEMORIES, Array, Effect, Plant
from estimator.gap.prediction import Fitted, Variable
from estimator.gap.search import (
    CHANCE,
    FORM,
    SETTLED,
    DiscoveredModel,
    Discovering,
    Discovery,
    Found,
    Named,
    deviate,
)

EXPLAINED: Final = 0.8
"""Part of the excess in prediction error that an effect's formula must take away by itself."""
MOST_OF: Final = 0.75
"""Part of what other effects explain beside one that a correction of that one must explain."""
SURE: Final = 2.0
"""Normal deviate beyond which one model predicts worse than another."""
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
class OwnForm:
    """One effect of the catalogue as the only one that is named, and the model with it.

    Attributes:
        named: the effect, with what it gains.
        fitted: fit with the effect's formula; if `named.read` is set, with a discovered curve in
            the place of the formula.
        variables: variables of that fit.
        corrected: model with the disturbance that corrects or replaces the formula; None if that
            has not been looked for.
    """

    named: Named
    fitted: Fitted
    variables: tuple[Variable, ...]
    corrected: DiscoveredModel | None = None


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


def choose(
    discovering: Discovering,
    found: Found,
    material: float,
    begun: DiscoveredModel | None = None,
) -> Choice:
    """Return which answer is chosen: the named effects, discovered disturbances, or both together.

    The disturbances are discovered here, as far as they are needed. Where one effect takes the
    place of those that the search named, it becomes the only one in `found`, with its fit.

    Args:
        discovering: discovers disturbances in the records of the search.
        found: finding of the search, with its floor; its `named`, `fitted` and `variables` may be
            changed in place.
        material: least excess, in variances per reading, that is looked into.
        begun: model with the first disturbance that is discovered without effects of the
            catalogue; None if it is not known yet.
    """
    plant, floor = discovering.plant, found.floor
    excess = found.refitted.cost - floor * found.samples
    given = DiscoveredModel(found.fitted, found.filtered, found.variables)
    pinned = _pinned(plant, found)
    one = _in_place_of_several(discovering, found, pinned)
    if one is not None:
        _take(found, one)
        pinned = _pinned(plant, found)
    names = one.corrected if one is not None and one.corrected is not None else given
    left = names.fitted.cost - floor * found.samples
    settled = left < min(FORM * excess, SETTLED * found.samples) and not pinned
    if left < material * found.samples or (found.named and settled):
        return Choice(names, bool(found.named), *_divided(plant, found, names))
    alone = discovering.run(found.refitted, discovering.nuisances, floor, begun=begun)
    nothing_named = Choice(alone, False, {}, tuple(alone.discoveries))
    own = None
    if not found.named or found.explained < EXPLAINED:
        own = _by_formula(discovering, found, alone)
        if own is not None:
            _take(found, own)
    parts = len(found.named) + len(names.discoveries)
    least = BEYOND * excess if parts <= len(alone.discoveries) else HALF * left
    better = bool(alone.discoveries) and _beats(alone.fitted.costs, names.fitted.costs, least)
    stands_in = pinned or (better and own is None and not _is_own(plant, found, alone))
    left_alone = alone.fitted.cost - floor * found.samples
    if not found.named or (better and stands_in and left_alone < (1.0 - WHOLE) * excess):
        return _by_its_curve(discovering, found, alone) or nothing_named
    beside = discovering.run(found.fitted, found.variables, floor)
    both = Choice(beside, True, *_divided(plant, found, beside))
    # Fewer curves, the first of which is a named effect's own, may do what formulas and curves do.
    fewer = len(alone.discoveries) < len(found.named) + len(both.discovered)
    needed = _beats(beside.fitted.costs, alone.fitted.costs, BEYOND * excess)
    if fewer and not needed and _is_own(plant, found, alone):
        by_its_curve = _by_its_curve(discovering, found, alone)
        if by_its_curve is not None:
            return by_its_curve
    doubted = bool(pinned) or stands_in
    told = found.explained >= EXPLAINED or _is_formula_of(plant, found, alone, excess)
    if own is None and (doubted or not told):
        # Names that are in doubt stand where without them half of the rest more would be left.
        least = HALF * left_alone if pinned or not stands_in else BEYOND * excess
        if not _beats(beside.fitted.costs, alone.fitted.costs, max(least, BEYOND * excess)):
            return _by_its_curve(discovering, found, alone) or nothing_named
    return both


def _take(found: Found, one: OwnForm) -> None:
    """Make one effect the only one that is named in a finding, with its fit and variables."""
    found.named, found.fitted, found.variables = [one.named], one.fitted, one.variables


def _by_its_curve(discovering: Discovering, found: Found, alone: DiscoveredModel) -> Choice | None:
    """Return the choice of an effect that was recognised by a discovered curve; None without one.

    The curve is the first disturbance of `alone`, and stands in the place of the effect's formula
    (`_by_likeness`). The effect becomes the only one that is named in `found`.
    """
    own = _by_likeness(discovering, found, alone)
    if own is None or own.corrected is None:
        return None
    _take(found, own)
    first, *others = own.corrected.discoveries
    return Choice(own.corrected, True, {own.named.effect: first}, tuple(others))


def _pinned(plant: Plant, found: Found) -> set[str]:
    """Return the names of the named effects whose size is at an end of what is plausible.

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
    """Return whether the first disturbance of `alone` is a named effect's own curve (`own`)."""
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
    """Return the disturbances that correct named effects, by the effects' names, and the others.

    A disturbance corrects an effect if it, or a rival of it, may be the effect in another form
    (`_forms`). Each effect is corrected by one disturbance at most.
    """
    corrections: dict[str, Discovery] = {}
    others: list[Discovery] = []
    for each in model.discoveries:
        where = (each.addition.place, each.addition.of)
        near = {where, *(rival.where[:2] for rival in each.rivals)}
        names = [n.effect for n in found.named if near & _forms(plant, plant.effects[n.effect])]
        name = next((name for name in names if name not in corrections), None)
        if name is None:
            others.append(each)
        else:
            corrections[name] = each
    return corrections, tuple(others)


# Effects whose formula is not the rig's


def _in_place_of_several(
    discovering: Discovering, found: Found, pinned: Collection[str]
) -> OwnForm | None:
    """Return one effect with a correction that does what several named effects do; None if none is.

    The effects share a place and a quantity, so that a curve there may be the same as several of
    their formulas. The one that explains most must explain `EXPLAINED` of the excess by itself,
    and its correction `MOST_OF` what the others explain beside it, or as much as they do to within
    chance. Effects in `pinned`, whose size is at an end of what is plausible, do not compete.
    """
    effects = [discovering.plant.effects[named.effect] for named in found.named]
    if len(effects) < 2 or not set(effects[0].own).intersection(*(e.own for e in effects[1:])):
        return None
    excess = found.refitted.cost - found.floor * found.samples
    likely = [each for each in effects if each.name not in pinned]
    best = _explaining_most(discovering, found, likely)
    if best is None or best.named.gain < EXPLAINED * excess:
        return None
    forms = _forms(discovering.plant, discovering.plant.effects[best.named.effect])
    model = discovering.run(best.fitted, best.variables, found.floor, 1, forms)
    if not model.discoveries:
        return None
    rest = best.fitted.cost - found.fitted.cost
    if _beats(found.fitted.costs, model.fitted.costs, (1.0 - MOST_OF) * rest):
        return None
    return replace(best, corrected=model)


def _by_formula(discovering: Discovering, found: Found, alone: DiscoveredModel) -> OwnForm | None:
    """Return the effect to which the first disturbance of `alone` belongs; None without one.

    Of the effects whose own curve that disturbance is, it is the one whose formula explains most,
    and it must explain `EXPLAINED` of the excess by itself. The result is also None if exactly one
    effect is named, and is one of these.
    """
    excess = found.refitted.cost - found.floor * found.samples
    if not alone.discoveries or excess <= 0.0:
        return None
    addition = alone.discoveries[0].addition
    effects = owners(discovering.plant, addition.place, addition.of)
    names = {named.effect for named in found.named}
    if len(names) == 1 and names <= {each.name for each in effects}:
        return None
    best = _explaining_most(discovering, found, effects)
    return None if best is None or best.named.gain < EXPLAINED * excess else best


def _forms(plant: Plant, effect: Effect) -> set[tuple[str, str]]:
    """Return places, each with a quantity, of curves that may be an effect in another form.

    They are the effect's own (`Effect.own`), and those of its parameter against whatever the plant
    lets it change with: a level of friction may grow with the pressure that a seal is under.
    """
    parameter = effect.knobs[0].parameter
    changing = [each for each in plant.varying if parameter in each.parameters]
    return {*effect.own, *((each.name, of) for each in changing for of in each.of)}


def owners(plant: Plant, place: str, of: str) -> list[Effect]:
    """Return the effects of a plant whose formula is a curve of a quantity at a place."""
    return [each for each in plant.effects.values() if (place, of) in each.own]


def _by_likeness(discovering: Discovering, found: Found, alone: DiscoveredModel) -> OwnForm | None:
    """Return the effect as which the first disturbance of `alone` is recognised; None without one.

    `Effect.like` recognises it by the course of its curve. The model of the result is `alone`: it
    has the disturbance in the place of the effect's formula.
    """
    if not alone.discoveries:
        return None
    first = alone.discoveries[0]
    addition = first.addition
    if addition.times or addition.form in MEMORIES:
        return None
    table = addition.form == "table"
    at = np.array(addition.at) if table else np.linspace(*first.reach, KNOTS)
    values = addition.shape(at)
    top = int(np.argmax(np.abs(values)))
    error = first.errors[top] if table else first.errors[0]
    size = values[top] if table else addition.values[0]
    for effect in discovering.plant.effects.values():
        knob = effect.knobs[0]
        for like in effect.like:
            if (like.place, like.of) != (addition.place, addition.of):
                continue
            value = like.read(at, values)
            if value is None or not knob.lower <= value <= knob.upper:
                continue
            moved = abs(value - discovering.plant.nominal[knob.parameter])
            read = (value, moved * abs(error / size))
            named = replace(_named(effect, found, alone.fitted), read=read)
            return OwnForm(named, alone.fitted, alone.variables, alone)
    return None


def _beats(one: Array, other: Array, least: float) -> bool:
    """Return whether block costs `one` sum to less than `other`, by `least` and beyond chance."""
    gains = other - one
    error = float(np.sqrt(len(gains)) * np.std(gains, ddof=1))
    return float(gains.sum()) > max(least, SURE * error)


def _explaining_most(
    discovering: Discovering, found: Found, effects: Sequence[Effect]
) -> OwnForm | None:
    """Return the one of some effects whose formula explains most by itself.

    None is returned without effects, or if the model breaks down with each of them.
    """
    best: OwnForm | None = None
    filtered = discovering.filtered(found.refitted.values)
    for effect in effects:
        fitted, variables = discovering.with_effect(filtered, effect)
        if fitted is None or (best is not None and fitted.cost >= best.fitted.cost):
            continue
        best = OwnForm(_named(effect, found, fitted), fitted, variables)
    return best


def _named(effect: Effect, found: Found, fitted: Fitted) -> Named:
    """Return an effect with what it gains over the refit of the nuisances in a fit with it."""
    gains = found.refitted.costs - fitted.costs
    gain = float(gains.sum())
    return Named(effect.name, gain, gain / found.samples, CHANCE, deviate(gains))
