"""The verdict and its reasons, and what the recordings held out say of each named effect."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.prediction import Curve, Filtered, Fitter, Values, Variable, Verdict, cost_of
from estimator.gap.search import CHANCE, HELD_OUT, MATERIAL, MOST_EFFECTS, Found, Refits, deviate

from .unsettled import LEFT, Unsettled

EXPLAINED: Final = 0.8
"""Part of the excess in prediction error that named effects must take away to be the whole
answer."""
SEVERAL: Final = 2
"""Channels that must be predicted worse than by resting: a single one may have a gap of its own."""
TOO_MUCH: Final = 25.0
"""Noise variances of excess that are more than one missing effect leaves in every equation."""
NOWHERE: Final = 0.3
"""Part of an excess that the best disturbance of a single equation must explain: more than its
share if force, both flows and the spool were wrong alike."""
FREE: Final = 0.05
"""Part of the excess that a free curve may still take away once the whole answer is named."""
PINNED: Final = 1e-3
"""Part of a size's plausible range: a size nearer than that to one of its ends would go further if
it might."""
AHEAD: Final = 5.0
"""Noise variances of gap over the horizon held out that are too much to be left, where names took
less than half away or are as many as may be. Chosen with blind trials in sight (docs/gap.md)."""
SURE: Final = 2.0
"""Standard deviations by which a gap must be above that bound: where a ram sticks and slips, twins
of the same rig differ by several noise variances."""
HALVED: Final = 0.5
"""Part of the gap over the horizon that names must take away, where more than that is left."""
SHOWN: Final = 1.0
"""Noise variances a reading held out that what is missing makes, from which it shows there: ten
times what is too much to be left."""
CONFIRMED: Final = 0.1
"""Part of what an effect would gain on held-out recordings, were it exact, that it must gain."""


@dataclass(frozen=True)
class Judgement:
    """A verdict with its reasons in words."""

    verdict: Verdict
    reasons: tuple[str, ...]


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


def judge(
    found: Found,
    rest: Sequence[Curve],
    resting: Sequence[str],
    held_out: float,
    held_out_before: float = float("nan"),
    located: float | None = None,
    ahead: tuple[float, float] = (float("nan"), float("nan")),
    unsettled: Sequence[Unsettled] = (),
    scatter: float = 0.0,
    worse: str | None = None,
) -> Judgement:
    """Return the verdict.

    Args:
        found: by the search, confirmed.
        rest: disturbances that would explain what is left, best first.
        resting: channels predicted worse than "nothing changes" would be, with all that was found.
        held_out: excess in squared error of the recordings held out, in variances a reading.
        held_out_before: the same, with nuisances refitted only.
        located: part of the excess that a disturbance of one equation explains; that of the best of
            `rest` if not given.
        ahead: gap over the horizon held out, of the model as given and with all that was found, in
            noise variances.
        scatter: of the gap that is left, by chance: one standard deviation.
        unsettled: of each channel, what of its errors goes with the motion with all that was found.
        worse: why the model with all that was named is worse than the one given, in words; None if
            it is not.
    """
    excess = found.fitted.cost / found.samples - found.floor
    if located is None:
        located = rest[0].share if rest else 0.0
    # What one equation lacks is of this rig, however badly it is predicted without.
    if len(resting) >= SEVERAL and not located > NOWHERE:
        return Judgement(
            "inconclusive",
            (
                f"even refitted, the model predicts {', '.join(resting)} worse than 'nothing "
                "changes' would: another rig, or a channel in other units or swapped",
            ),
        )
    if not np.isfinite(excess) or (
        excess > TOO_MUCH
        and (not found.named or found.explained < EXPLAINED)
        and not located > NOWHERE
    ):
        return Judgement(
            "inconclusive",
            (
                f"predictions miss by {max(excess, 0.0) ** 0.5:.0f} times the noise, and no "
                "disturbance of a single equation explains it: too much is wrong at once; is this "
                "the rig that the model describes?",
            ),
        )
    # A free curve costs no physics: names that leave it much to explain are not the cause.
    free = rest[0].share * excess if rest else 0.0
    before = found.refitted.cost / found.samples - found.floor
    unexplained = excess > MATERIAL and (not found.named or found.explained < EXPLAINED)
    if free > MATERIAL and (unexplained or free > FREE * before):
        return Judgement("unknown_effect", _unknown(found, rest[0]))
    stirred = [channel for channel in unsettled if channel.counts]
    # A motion held out that shows what is missing, and that names predict, outweighs one fitted to.
    borne_out = held_out_before > SHOWN and held_out < LEFT * held_out_before
    if stirred and not (found.named and borne_out):
        return Judgement("unknown_effect", (_stirred(found, stirred),))
    beyond = _at_an_end(found)
    if beyond and excess > MATERIAL and not borne_out:
        return Judgement("unknown_effect", (_implausible(found, beyond, excess),))
    if found.named and held_out > max(HELD_OUT, (1.0 - EXPLAINED) * held_out_before):
        return Judgement("unknown_effect", (_not_held_out(found, held_out, held_out_before),))
    given, left = ahead
    if (
        found.named
        and left > AHEAD + SURE * scatter
        and (left > (1.0 - HALVED) * given or len(found.named) == MOST_EFFECTS)
    ):
        return Judgement("unknown_effect", (_not_ahead(found, given, left),))
    if found.named and worse:
        return Judgement("unknown_effect", (_worse(found, worse),))
    if found.named:
        return Judgement("missing_effect", _missing(found, excess))
    if held_out > HELD_OUT:
        return Judgement(
            "inconclusive",
            (
                "the recordings fitted to are predicted as well as their noise allows, those held "
                f"out are not, by {held_out:.2g} noise variances a reading: something is missing "
                "that the motions fitted to do not show; fit to motions like those held out",
            ),
        )
    return Judgement("adequate", _adequate(excess))


def _at_an_end(found: Found) -> list[Variable]:
    """Return the sizes of named effects that are at an end of what is plausible."""
    names = {named.effect for named in found.named}
    sizes = {v.name: v for v in reversed(found.variables) if v.key and v.name in names}
    pinned = []
    for variable in sizes.values():
        value, given = (f.values[variable.parameter] for f in (found.fitted, found.given))
        near = PINNED * (variable.upper - variable.lower)
        ends = [end for end in (variable.lower, variable.upper) if abs(end - given) > near]
        if any(abs(value - end) <= near for end in ends):
            pinned.append(variable)
    return pinned


def _stirred(found: Found, stirred: Sequence[Unsettled]) -> str:
    worst = max(stirred, key=lambda channel: channel.stirred)
    top = int(np.argmax(worst.values))
    what = (
        f"errors of {worst.channel} stay {worst.mean:.2g} predicted variances above the noise, "
        f"and it goes with the {worst.region}: {worst.values[top]:.2g} at {worst.at[top]:.3g} "
        f"{worst.unit}, {worst.values.min():.2g} where they are least"
    )
    if not found.named:
        return f"{what}; no effect of the catalogue explains it, nor does noise of a sensor"
    names = " and ".join(named.effect for named in found.named)
    return (
        f"with {names}, {what}; the cause itself would leave no more than noise, so that nothing "
        "is named: something acts that no steady law tells, such as a resonance or chance"
    )


def _implausible(found: Found, beyond: Sequence[Variable], excess: float) -> str:
    sizes = " and ".join(
        f"{variable.name} of {found.fitted.values[variable.parameter]:.3g}" for variable in beyond
    )
    return (
        f"{sizes}, the most that is plausible, would explain a part, but {excess:.2g} noise "
        "variances a reading stay: it stands in for something else, so that nothing is named"
    )


def _unknown(found: Found, curve: Curve) -> tuple[str, ...]:
    reasons = [
        "predictions stay worse than the sensors' noise allows; a disturbance of the "
        f"{curve.equation} that depends on {curve.region} would take away {curve.share:.0%} of "
        "that, and no effect of the catalogue does"
    ]
    if found.named:
        names = " and ".join(named.effect for named in found.named)
        reasons.append(
            f"{names} would take away {max(found.explained, 0.0):.0%} of the excess: too little to "
            f"be named, {EXPLAINED:.0%} are needed"
            if found.explained < EXPLAINED
            else f"{names} would take away {found.explained:.0%} of the excess, but no more than "
            "something unknown would in their likeness: the curve explains what they leave"
        )
    return tuple(reasons)


def _not_held_out(found: Found, after: float, before: float) -> str:
    names = " and ".join(named.effect for named in found.named)
    return (
        f"{names} would explain the recordings fitted to, but those held out are still predicted "
        f"{after:.2g} noise variances a reading worse than the noise allows, of {before:.2g} "
        f"without them: less than {EXPLAINED:.0%} is explained there, so that nothing is named"
    )


def _not_ahead(found: Found, given: float, left: float) -> str:
    names = " and ".join(named.effect for named in found.named)
    return (
        f"{names} would lower one-step errors, but over the horizon held out {left:.2g} of "
        f"{given:.2g} noise variances are left: they stand in for something else, so that nothing "
        "is named"
    )


def _worse(found: Found, worse: str) -> str:
    names = " and ".join(named.effect for named in found.named)
    return f"{names} would lower one-step errors, but {worse}; nothing is named"


def _missing(found: Found, excess: float) -> tuple[str, ...]:
    reasons = [
        f"with {named.effect} the squared prediction error falls by {named.per_reading:.3g} noise "
        f"variances a reading, {named.gain / named.bar:.0f} times what chance or a trifle would "
        f"give (z = {named.z:.0f})"
        for named in found.named
    ]
    if excess > MATERIAL:
        reasons.append(f"{excess:.2g} noise variances a reading stay unexplained")
    return tuple(reasons)


def _adequate(excess: float) -> tuple[str, ...]:
    if excess > MATERIAL:
        return (
            f"predictions are {excess:.2g} noise variances a reading worse than the stated noise "
            "allows, but no effect and no disturbance that depends on the motion explains it: the "
            "sensors may be noisier than stated",
        )
    return ("what the model predicts differs from the readings by their noise",)
