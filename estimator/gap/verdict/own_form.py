"""This module names effects of the catalogue whose formula is not the rig's.

An effect is named by where it enters, against what, and in which regime; its formula is a first
guess. A disturbance that was discovered in an effect's own place, against its own quantity, is that
effect with another form, if the effect's formula explains most of the excess, or if the curve runs
as the effect does.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import KNOTS, Array, Effect
from estimator.gap.prediction import Fitted, Variable
from estimator.gap.search import (
    CHANCE,
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


@dataclass(frozen=True)
class OwnForm:
    """An effect of the catalogue with the model in which it has a formula or a form of its own.

    Attributes:
        named: the effect, with what it gains.
        fitted: fit with the effect.
        variables: variables of that fit.
        corrected: model with the effect and its correction; None if it is to be looked for.
    """

    named: Named
    fitted: Fitted
    variables: tuple[Variable, ...]
    corrected: DiscoveredModel | None = None


def in_place_of_several(
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
    own = discovering.plant.effects[best.named.effect].own
    model = discovering.run(best.fitted, best.variables, found.floor, 1, own)
    if not model.discoveries:
        return None
    rest = best.fitted.cost - found.fitted.cost
    if beats(found.fitted.costs, model.fitted.costs, (1.0 - MOST_OF) * rest):
        return None
    return replace(best, corrected=model)


def by_formula(discovering: Discovering, found: Found, alone: DiscoveredModel) -> OwnForm | None:
    """Return the effect to which the first disturbance belongs; None if there is none.

    Of the effects whose own curve was discovered, it is the one that explains most, and it explains
    `EXPLAINED` of the excess by itself. There is none either where a single effect of these was
    named before.
    """
    excess = found.refitted.cost - found.floor * found.samples
    if not alone.discoveries or excess <= 0.0:
        return None
    effects = _owners(discovering, alone.discoveries[0])
    names = {named.effect for named in found.named}
    if len(names) == 1 and names <= {each.name for each in effects}:
        return None
    best = _explaining_most(discovering, found, effects)
    return None if best is None or best.named.gain < EXPLAINED * excess else best


def by_likeness(discovering: Discovering, found: Found, alone: DiscoveredModel) -> OwnForm | None:
    """Return the effect that the first disturbance is by its course (`Likeness`); None if none is.

    The model has the disturbance in the place of the effect's formula.
    """
    if not alone.discoveries:
        return None
    first = alone.discoveries[0]
    addition = first.addition
    if addition.times:
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


def beats(one: Array, other: Array, least: float) -> bool:
    """Return whether block costs `one` are less than `other`, by `least` and beyond chance."""
    gains = other - one
    error = float(np.sqrt(len(gains)) * np.std(gains, ddof=1))
    return float(gains.sum()) > max(least, SURE * error)


def _explaining_most(
    discovering: Discovering, found: Found, effects: Sequence[Effect]
) -> OwnForm | None:
    """Return the effect whose formula explains most by itself; None if no model is sound."""
    best: OwnForm | None = None
    for effect in effects:
        fitted, variables = discovering.with_effect(found.refitted.values, effect)
        if fitted is None or (best is not None and fitted.cost >= best.fitted.cost):
            continue
        best = OwnForm(_named(effect, found, fitted), fitted, variables)
    return best


def _named(effect: Effect, found: Found, fitted: Fitted) -> Named:
    """Return an effect with what it gains over the refit of the nuisances in a fit with it."""
    gains = found.refitted.costs - fitted.costs
    gain = float(gains.sum())
    return Named(effect.name, gain, gain / found.samples, CHANCE, deviate(gains))


def _owners(discovering: Discovering, discovery: Discovery) -> list[Effect]:
    """Return the effects whose formula is a curve where a disturbance was discovered."""
    where = (discovery.addition.place, discovery.addition.of)
    return [each for each in discovering.plant.effects.values() if where in each.own]
