"""This module gives up named effects that the model that was chosen does not need.

An effect earns its place while the catalogue is searched. What is discovered afterwards may do what
it did: a catalogue without the second order of a lag makes up for it by two effects more, until the
resonance is found. So what a name must earn is asked once more of the whole model, and with the
interval that is reported.

Nor may an effect explain less than the whole model leaves unexplained. So much the forms of the
others are known to be wrong by, and a fit spends any formula that is at hand on making up for it.
"""

from dataclasses import replace

import numpy as np

from estimator.gap.prediction import effect_variables
from estimator.gap.search import NORMAL_95, Discovering, Found, Named, Search

from .choosing import Choice
from .intervals import form_error, standard_errors


def without_unneeded(
    search: Search, discovering: Discovering, found: Found, choice: Choice
) -> Choice:
    """Return the choice without named effects that do not earn their place in its model.

    Such an effect gains too little beside all else (`Search.eliminate`), explains less than the
    model leaves (`_outweighed`), or its interval holds its value in the model given. The last
    effect is never given up. What corrected an effect that is given up becomes a disturbance like
    the others.

    Args:
        search: the search that found the effects.
        discovering: what found the disturbances.
        found: the finding, with its floor; it gets the model of the choice, and its `named` is
            changed in place.
        choice: the answer that was chosen.
    """
    if not choice.named or len(found.named) < 2:
        return choice
    model, before = choice.model, list(found.named)
    found.fitted, found.filtered, found.variables = model.fitted, model.filtered, model.variables
    for named in _outweighed(found, choice):
        search.give_up(found, named)
    # Without disturbances the search has asked this already.
    if model.discoveries:
        search.eliminate(found)
    while len(found.named) > 1 and (vague := _vaguest(search, found)) is not None:
        search.give_up(found, vague)
    if len(found.named) == len(before):
        return choice
    left = replace(model, fitted=found.fitted, filtered=found.filtered, variables=found.variables)
    settled = discovering.settled(left) if model.discoveries else left
    now = dict(zip(map(id, model.discoveries), settled.discoveries, strict=True))
    kept = {named.effect for named in found.named}
    given_up = [each for name, each in choice.corrections.items() if name not in kept]
    return Choice(
        settled,
        True,
        {name: now[id(each)] for name, each in choice.corrections.items() if name in kept},
        tuple(now[id(each)] for each in (*given_up, *choice.discovered)),
    )


def _outweighed(found: Found, choice: Choice) -> list[Named]:
    """Return the named effects that explain less than the model leaves, that of least first.

    What an effect explains is what it gained in the search, and what the disturbance that corrects
    its formula takes away. The effect that explains most is never among them.
    """
    floor = found.floor * found.samples
    left, excess = found.fitted.cost - floor, found.refitted.cost - floor
    explained = [
        (named.gain + (correction.share * excess if correction is not None else 0.0), named)
        for named in found.named
        for correction in [choice.corrections.get(named.effect)]
    ]
    explained.sort(key=lambda each: each[0])
    return [named for gain, named in explained[:-1] if gain < left]


def _vaguest(search: Search, found: Found) -> Named | None:
    """Return the named effect whose size is least sure, if its interval holds that given.

    Effects with several knobs, which have no one size, do not count, nor do those whose size was
    read off a curve. None is returned if each interval leaves that value out.
    """
    errors, values = standard_errors(search, found), found.fitted.values
    vaguest, least = None, 1.0
    for named in found.named:
        own = effect_variables(search.plant.effects[named.effect])
        if len(own) != 1 or named.read is not None or own[0].parameter not in errors:
            continue
        name, before = own[0].parameter, search.plant.nominal[own[0].parameter]
        error = float(np.hypot(errors[name], form_error(values[name], before)))
        sure = abs(values[name] - before) / max(NORMAL_95 * error, 1e-300)
        if sure < least:
            least, vaguest = sure, named
    return vaguest
