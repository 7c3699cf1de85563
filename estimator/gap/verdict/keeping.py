"""This module holds a fitted model against recordings that nothing was fitted to.

If the fitted model predicts worse than the model as given, the latter is written instead.
Predictions over the horizon are compared. A refit claims nothing, so that it must not raise the
held-out gap at all. Named effects have evidence of their own, and a held-out motion that hardly
shows them may raise the gap by a trifle. Named effects are given up if the errors grow by more than
chance.

The module also tells how surely each named effect lowers the error there, and how much of what is
left would go with other values of the nuisances. Friction is not the same from run to run: a model
that is fitted to some recordings cannot predict the friction of others, whatever it holds.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from estimator.gap.plant import Array, Plant
from estimator.gap.prediction import (
    Fitter,
    GapResult,
    Values,
    Variable,
    channel_gaps,
    mean_gap,
    mean_squares,
)
from estimator.gap.search import CHANCE, Found, Named, Refits, deviate

from .choosing import PINNED, SURE

TRIFLE: Final = 0.1
"""Growth of errors, in noise variances, for which no effect is given up: ten times what matters to
a prediction."""
LOOKED_INTO: Final = 0.1
"""Least gap, in noise variances, that is looked into: ten times what matters to a prediction."""
PART: Final = 0.05
"""Part of the gap of the model as given that the model written must leave to be looked into, and
part of what is left that the refit must take away to be told."""
_MOVED: Final = 2e-3
"""Part of its value that a nuisance must move to be told."""


@dataclass(frozen=True)
class Growth:
    """The growth of squared errors over the horizon from one model to another.

    Attributes:
        mean: mean growth over half-second blocks and channels, in noise variances; infinite if the
            second model's predictions are not finite where the first's are.
        error: standard error of the mean, by the scatter of the blocks.

    Both are 0 if fewer than two blocks can be compared.
    """

    mean: float
    error: float

    @property
    def matters(self) -> bool:
        """Return whether `mean` is more than `TRIFLE` and more than `SURE` times `error`."""
        return self.mean > max(TRIFLE, SURE * self.error)


def growth(fitter: Fitter, given: Values, fitted: Values) -> Growth:
    """Return how much squared errors over the horizon grow from the given model to a fitted one.

    `given` and `fitted` are the values of all parameters in each model. Each model filters the
    records of `fitter` with filter gains of its own.
    """
    predictor = fitter.predictor
    variances = np.array([output.variance for output in predictor.plant.outputs])

    def of_blocks(values: Values) -> Array:
        filtered = fitter.filtered(values)
        states = [states for _, states in filtered.innovations(values)]
        ahead = fitter.pool.map(
            lambda record, state: predictor.ahead(record, values, state), fitter.records, states
        )
        parts = zip(ahead, fitter.blocks, strict=True)
        squares = [mean_squares(errors[block]) for errors, blocks in parts for block in blocks]
        return np.array(squares) / variances

    before, after = of_blocks(given), of_blocks(fitted)
    known = np.isfinite(before)
    if not np.isfinite(after[known]).all():
        return Growth(np.inf, 0.0)
    known &= np.isfinite(after)
    changes = np.where(known, after, 0.0) - np.where(known, before, 0.0)
    used = known.any(axis=1)
    grown = changes[used].sum(axis=1) / known[used].sum(axis=1)
    if len(grown) < 2:
        return Growth(0.0, 0.0)
    return Growth(float(grown.mean()), float(grown.std(ddof=1) / np.sqrt(len(grown))))


@dataclass(frozen=True)
class Worse:
    """The reason why a fitted model is worse than the given one.

    Attributes:
        words: the reason, in words.
        beyond_chance: whether it is worse by more than chance. Named effects are then given up.
    """

    words: str
    beyond_chance: bool


def why_worse(
    held_out: Growth, gap: tuple[float, float], fitted_to: Growth | None = None, *, named: bool
) -> Worse | None:
    """Return why a fitted model predicts worse than the model as given; None if it does not.

    It is worse on the recordings held out if `held_out` matters (`Growth.matters`), or if the gap
    has risen. It is also worse if `fitted_to` matters.

    Args:
        held_out: how much its errors over the horizon grew on the recordings held out.
        gap: the gap on the recordings held out, first of the model as given, then of the fitted
            one. Both are in noise variances above the floor of the fitted model.
        fitted_to: how much its errors grew on the recordings it was fitted to; None skips this.
        named: whether effects were named. If so, the gap may rise by `TRIFLE`; if not, it may not
            rise at all.
    """
    given, left = gap
    if held_out.matters or left > given + (TRIFLE if named else 0.0):
        if not np.isfinite(held_out.mean):
            return Worse("the recordings held out could not be predicted at all", True)
        grown = f"by {held_out.mean:.3g} noise variances over the horizon"
        if left > given:
            grown = f"{left:.3g} noise variances above the floor instead of {given:.3g}"
        return Worse(
            f"the recordings held out would be predicted worse than by the model as given: {grown}",
            held_out.matters,
        )
    if fitted_to is not None and fitted_to.matters:
        return Worse(
            "over the horizon even the recordings fitted to would be predicted worse than by the "
            f"model as given, by {fitted_to.mean:.2g} noise variances",
            True,
        )
    return None


def take_back(result: GapResult, plant: Plant, fitted: str, worse: Worse) -> None:
    """Make the model as given the one that is written, and add the reason to the result.

    Effects stay named if the model with them may be worse by chance only. If it is worse beyond
    chance, effects in the result are given up, and the verdict becomes `unknown_effect`; without
    effects the verdict stays. Nothing that was discovered is in the model written. The gaps of the
    channels are emptied, to be measured anew by the caller.

    Args:
        result: result of the workflow; changed in place.
        plant: plant with the model as given.
        fitted: what is not written, in words.
        worse: why the fitted model is worse.
    """
    chance = "" if worse.beyond_chance else ", though it may be by chance"
    result.reasons.append(f"with {fitted}, {worse.words}{chance}; the model is written as given")
    if result.effects and worse.beyond_chance:
        result.verdict, result.effects, result.experiments = "unknown_effect", [], []
        result.rest, result.explained = result.where, float("nan")
    result.values, result.names, result.as_given = dict(plant.nominal), (), True
    result.discovered = [replace(each, in_model=False) for each in result.discovered]
    result.channels = []


def at_an_end(variable: Variable, values: Values) -> bool:
    """Return whether a refitted parameter is at an end of its tolerance or beyond it.

    At an end means within the part `PINNED` of the distance between both ends. A variable that is
    held counts as being at none.
    """
    if variable.is_held:
        return False
    near = PINNED * (variable.upper - variable.lower)
    value = values[variable.parameter]
    return bool(min(value - variable.lower, variable.upper - value) <= near)


def ends_in_words(variables: Sequence[Variable], values: Values) -> list[str]:
    """Return a list with one warning if nuisances have come to an end of their tolerances.

    Without such nuisances the list is empty. Knobs of effects do not count.
    """
    names = [v.parameter for v in variables if not v.key and at_an_end(v, values)]
    if not names:
        return []
    were, end = (
        ("was", "an end of its tolerance")
        if len(names) == 1
        else ("were", "the ends of their tolerances")
    )
    return [
        f"{' and '.join(names)} {were} refitted to {end}: something else is wrong that this makes "
        "up for in part, or the rig is farther from its model than that"
    ]


def held_out_deviate(refits: Refits, found: Found, named: Named, judged: Fitter) -> float:
    """Return the normal deviate of a named effect's gain on the held-out recordings.

    It is only reported: nothing is decided by it. Where what the effect changes in the predictions
    costs less than `CHANCE`, the held-out motion shows nothing of the effect, and the deviate is
    NaN. That cost is not the square of the change: on a stop that the model lacks, a few readings
    would then outweigh all others. `judged` is the fitter of the held-out records.
    """
    values = found.fitted.values
    held_out = judged.filtered(values)
    without = found.refitted if named.read else refits.without(found, named.effect)[1]
    both = zip(held_out.innovations(values), held_out.innovations(without.values), strict=True)
    expected = held_out.costs_of([one - other for (one, _), (other, _) in both]).sum()
    if expected < CHANCE:
        return float("nan")
    return deviate(held_out.costs(without.values) - held_out.costs(values))


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
    if not left > max(LOOKED_INTO, PART * before):
        return []
    refits = Refits(judged)
    refitted = refits.settled(values, refits.nuisances)[0].values
    gaps = channel_gaps(
        judged.predictor, judged.records, values, refitted, judged.pool, measured=judged.measured
    )
    still = mean_gap(gaps)[1]
    names = [variable.parameter for variable in refits.nuisances]
    moved = {name: refitted[name] / values[name] - 1.0 for name in names if values[name]}
    told = ", ".join(
        f"{name} {abs(change):.1%} {'more' if change > 0.0 else 'less'}"
        for name, change in moved.items()
        if abs(change) > _MOVED
    )
    if not told or not left - still > PART * left:
        return []
    return [
        f"of the {left:.3g} noise variances left on the recordings held out, {left - still:.2g} "
        f"would go with nuisances refitted to these alone ({told}): the machine was not quite the "
        "same there, or the model errs otherwise in that motion"
    ]
