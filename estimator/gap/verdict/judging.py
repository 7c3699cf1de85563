"""This module gives the verdict and its reasons by rules, of which the first that applies decides.

Some bounds are derived; the others were chosen, and their docstrings say so. How often the verdicts
are right was measured on hidden rigs (docs/gap.md, "Measured").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.prediction import Curve, Variable, Verdict
from estimator.gap.search import HELD_OUT, MATERIAL, MOST_EFFECTS, Found

from .unsettled import LEFT, Unsettled

EXPLAINED: Final = 0.8
"""Part of the excess in prediction error that named effects must take away to be the whole answer.
This bound was chosen."""
SEVERAL: Final = 2
"""Least number of channels that the model must predict worse than the assumption that nothing
changes. A single channel may have a gap of its own."""
TOO_MUCH: Final = 25.0
"""Excess in noise variances, five standard deviations. One missing effect may leave more only if
one equation explains it. This bound was chosen."""
NOWHERE: Final = 0.3
"""Part of an excess that the best disturbance of a single equation must explain. It is more than
each equation would explain if force, both flows and the spool were wrong alike."""
FREE: Final = 0.05
"""Part of the excess that a free curve may still take away if named effects are the whole answer.
This bound was chosen."""
PINNED: Final = 1e-3
"""Part of a size's plausible range. A size that is nearer than this to an end of the range counts
as being at that end. This bound was chosen: it is far less than the errors of fitted sizes."""
AHEAD: Final = 5.0
"""Gap over the horizon on held-out recordings, in noise variances. More must not be left where
named effects took away less than half, or where no more effects may be named. This bound was chosen
with blind trials in sight (docs/gap.md)."""
SURE: Final = 2.0
"""Standard deviations by which a gap must exceed `AHEAD`, because twins of the same rig differ by
several noise variances where a ram sticks and slips."""
HALVED: Final = 0.5
"""Part of the gap over the horizon that named effects must take away where more than `AHEAD` is
left. It was chosen together with `AHEAD`."""
SHOWN: Final = 1.0
"""Noise variances per held-out reading. A missing effect shows in the held-out recordings if it
causes more: ten times `HELD_OUT`."""


@dataclass(frozen=True)
class Judgement:
    """A verdict with its reasons in words."""

    verdict: Verdict
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """Everything that a verdict depends on.

    Attributes:
        found: finding of the search, after its effects were confirmed.
        rest: disturbances that would explain what is left, the best first.
        located: part of the excess that the best disturbance of one equation explains.
        resting: channels that the model with all that was found predicts worse than the assumption
            that nothing changes.
        unsettled: for each channel, the part of its errors that depends on the motion, with all
            that was found.
        held_out: excess in squared error on the held-out recordings, in variances per reading.
        held_out_before: the same excess with only the nuisances refitted.
        ahead: gap over the horizon on held-out recordings, in noise variances, first of the model
            as given, then with all that was found; NaN if nothing was named.
        scatter: standard deviation by which the second of these gaps varies by chance.
        worse: reason, in words, why the model with all named effects is worse than the given one;
            None if it is not, or if it may be by chance.
    """

    found: Found
    rest: Sequence[Curve]
    located: float
    resting: Sequence[str]
    unsettled: Sequence[Unsettled]
    held_out: float
    held_out_before: float
    ahead: tuple[float, float]
    scatter: float
    worse: str | None

    @property
    def excess(self) -> float:
        """Return the cost that the finding leaves above the floor, in variances per reading."""
        return self.found.fitted.cost / self.found.samples - self.found.floor

    @property
    def whole(self) -> bool:
        """Return whether effects are named and take away the part `EXPLAINED` of the excess."""
        return bool(self.found.named) and not self.found.explained < EXPLAINED

    @property
    def borne_out(self) -> bool:
        """Return whether a held-out motion shows what is missing and the named effects predict it.

        Without the effects the held-out excess is above `SHOWN`; with them it is less than the part
        `LEFT` of that. This outweighs evidence from a motion to which the effects were fitted.
        """
        return self.held_out_before > SHOWN and self.held_out < LEFT * self.held_out_before

    @property
    def names(self) -> str:
        """Return the names of the named effects, joined by "and"."""
        return " and ".join(named.effect for named in self.found.named)


Rule = Callable[[Evidence], Judgement | None]
"""A rule returns its judgement where it applies, else None."""


def judge(evidence: Evidence) -> Judgement:
    """Return the judgement of the first of `RULES` that applies; if none does, "adequate"."""
    judgements = (rule(evidence) for rule in RULES)
    return next((found for found in judgements if found is not None), _adequate(evidence.excess))


# Rules by which the recordings support no verdict


def another_rig(evidence: Evidence) -> Judgement | None:
    """Judge "inconclusive" if "nothing changes" predicts better than the model; else return None.

    The recordings may come from another rig, or their channels may be mixed up. `SEVERAL` channels
    must be affected, because one may have a gap of its own. The rule does not apply if a
    disturbance of one equation explains more than `NOWHERE` of the excess: that equation lacks
    something, and the rig is the right one.
    """
    if len(evidence.resting) < SEVERAL or evidence.located > NOWHERE:
        return None
    return Judgement(
        "inconclusive",
        (
            f"even refitted, the model predicts {', '.join(evidence.resting)} worse than 'nothing "
            "changes' would: another rig, or a channel in other units or swapped",
        ),
    )


def too_much_at_once(evidence: Evidence) -> Judgement | None:
    """Judge "inconclusive" if errors are too large for any single effect; else return None.

    This means that more than `TOO_MUCH` is left, that named effects are not the whole answer, and
    that no single equation explains more than `NOWHERE` of it. An excess that is not finite counts
    as too large.
    """
    excess = evidence.excess
    spread = excess > TOO_MUCH and not evidence.whole and not evidence.located > NOWHERE
    if np.isfinite(excess) and not spread:
        return None
    return Judgement(
        "inconclusive",
        (
            f"predictions miss by {max(excess, 0.0) ** 0.5:.0f} times the noise, and no "
            "disturbance of a single equation explains it: too much is wrong at once; is this "
            "the rig that the model describes?",
        ),
    )


# Rules by which something acts for which no effect was named, or only one that stands in for it


def left_to_a_curve(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if a free curve explains much of what is left; else return None.

    A curve needs no physics: effects that leave it much to explain are not the cause. What it
    explains must exceed `MATERIAL`, the least that matters to a prediction. That is enough if no
    effect is named or if those named are too little (`EXPLAINED`). If they are the whole answer, it
    must also exceed the part `FREE` of the excess before them.
    """
    found, excess = evidence.found, evidence.excess
    free = evidence.rest[0].share * excess if evidence.rest else 0.0
    before = found.refitted.cost / found.samples - found.floor
    unexplained = excess > MATERIAL and not evidence.whole
    if not (free > MATERIAL and (unexplained or free > FREE * before)):
        return None
    curve = evidence.rest[0]
    reasons = [
        "predictions stay worse than the sensors' noise allows; a disturbance of the "
        f"{curve.equation} that depends on {curve.region} would take away {curve.share:.0%} of "
        "that, and no effect of the catalogue does"
    ]
    if found.named:
        reasons.append(
            f"{evidence.names} would take away {max(found.explained, 0.0):.0%} of the excess: too "
            f"little to be named, {EXPLAINED:.0%} are needed"
            if found.explained < EXPLAINED
            else f"{evidence.names} would take away {found.explained:.0%} of the excess, but no "
            "more than something unknown would in their likeness: the curve explains what they "
            "leave"
        )
    return Judgement("unknown_effect", tuple(reasons))


def goes_with_the_motion(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if squared errors grow with the motion; else return None.

    A resonance, or something random, leaves errors of mean 0: no fitted curve shows them, but their
    squares do (`Unsettled.counts`). The rule does not apply if effects are named and a held-out
    motion bears them out.
    """
    stirred = [channel for channel in evidence.unsettled if channel.counts]
    if not stirred or (evidence.found.named and evidence.borne_out):
        return None
    worst = max(stirred, key=lambda channel: channel.stirred)
    top = int(np.argmax(worst.values))
    what = (
        f"errors of {worst.channel} stay {worst.mean:.2g} predicted variances above the noise, "
        f"and it goes with the {worst.region}: {worst.values[top]:.2g} at {worst.at[top]:.3g} "
        f"{worst.unit}, {worst.values.min():.2g} where they are least"
    )
    if not evidence.found.named:
        said = f"{what}; no effect of the catalogue explains it, nor does noise of a sensor"
    else:
        said = (
            f"with {evidence.names}, {what}; the cause itself would leave no more than noise, so "
            "that nothing is named: something acts that no steady law tells, such as a resonance "
            "or chance"
        )
    return Judgement("unknown_effect", (said,))


def at_an_end(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if a named size is at an end of what is plausible; else return None.

    A fit would move such a size (`PINNED`) beyond the end, so that the effect stands in for
    something else. The size is the effect's first knob; an end at which it was in the model as
    given does not count. The rule applies only if more than `MATERIAL` is left, the least that
    matters, and if no held-out motion bears the named effects out.
    """
    beyond = _pinned(evidence.found)
    if not beyond or not evidence.excess > MATERIAL or evidence.borne_out:
        return None
    values = evidence.found.fitted.values
    sizes = " and ".join(f"{each.name} of {values[each.parameter]:.3g}" for each in beyond)
    return Judgement(
        "unknown_effect",
        (
            f"{sizes}, the most that is plausible, would explain a part, but {evidence.excess:.2g} "
            "noise variances a reading stay: it stands in for something else, so that nothing is "
            "named",
        ),
    )


def not_held_out(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if named effects fail on held-out recordings; else return None.

    On the held-out recordings they must explain as large a part as on those fitted to
    (`EXPLAINED`), unless no more is left there than a model leaves that lacks nothing (`HELD_OUT`).
    """
    after, before = evidence.held_out, evidence.held_out_before
    if not evidence.found.named or not after > max(HELD_OUT, (1.0 - EXPLAINED) * before):
        return None
    return Judgement(
        "unknown_effect",
        (
            f"{evidence.names} would explain the recordings fitted to, but those held out are "
            f"still predicted {after:.2g} noise variances a reading worse than the noise allows, "
            f"of {before:.2g} without them: less than {EXPLAINED:.0%} is explained there, so that "
            "nothing is named",
        ),
    )


def not_ahead(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if named effects leave too large a gap; else return None.

    The gap over the horizon that is left exceeds `AHEAD` by more than `SURE` times the scatter of
    twins. In addition, either the effects took away less than the part `HALVED` of the gap, or as
    many effects are named as are allowed, which do not suffice.
    """
    found, (given, left) = evidence.found, evidence.ahead
    if not found.named or not left > AHEAD + SURE * evidence.scatter:
        return None
    if not (left > (1.0 - HALVED) * given or len(found.named) == MOST_EFFECTS):
        return None
    return Judgement(
        "unknown_effect",
        (
            f"{evidence.names} would lower one-step errors, but over the horizon held out "
            f"{left:.2g} of {given:.2g} noise variances are left: they stand in for something "
            "else, so that nothing is named",
        ),
    )


def worse_than_given(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if the model with named effects is worse; else return None.

    It is compared with the model as given, and must be worse by more than chance (`why_worse`).
    """
    if not evidence.found.named or not evidence.worse:
        return None
    said = f"{evidence.names} would lower one-step errors, but {evidence.worse}; nothing is named"
    return Judgement("unknown_effect", (said,))


# Rules by which the answer is known, or known to be missing


def missing_effect(evidence: Evidence) -> Judgement | None:
    """Judge "missing_effect" if effects are named; else return None.

    No earlier rule speaks against these effects, which earned their place in the search.
    """
    if not evidence.found.named:
        return None
    reasons = [
        f"with {named.effect} the squared prediction error falls by {named.per_reading:.3g} noise "
        f"variances a reading, {named.gain / named.bar:.0f} times what chance or a trifle would "
        f"give (z = {named.z:.0f})"
        for named in evidence.found.named
    ]
    if evidence.excess > MATERIAL:
        reasons.append(f"{evidence.excess:.2g} noise variances a reading stay unexplained")
    return Judgement("missing_effect", tuple(reasons))


def not_shown(evidence: Evidence) -> Judgement | None:
    """Judge "inconclusive" if the model predicts held-out recordings too badly; else return None.

    The bound is `HELD_OUT`. Such a model is not adequate, but the motions fitted to do not show
    what it lacks.
    """
    if not evidence.held_out > HELD_OUT:
        return None
    return Judgement(
        "inconclusive",
        (
            "the recordings fitted to are predicted as well as their noise allows, those held "
            f"out are not, by {evidence.held_out:.2g} noise variances a reading: something is "
            "missing that the motions fitted to do not show; fit to motions like those held out",
        ),
    )


RULES: Final[tuple[Rule, ...]] = (
    another_rig,
    too_much_at_once,
    left_to_a_curve,
    goes_with_the_motion,
    at_an_end,
    not_held_out,
    not_ahead,
    worse_than_given,
    missing_effect,
    not_shown,
)
"""The rules, in the order in which they are tried: first whether there is anything to judge, then
what speaks against named effects, then the answer."""


def _adequate(excess: float) -> Judgement:
    """Return the judgement that nothing is missing, with a reason that depends on the excess.

    `excess` is the cost left above the floor, in variances per reading.
    """
    if excess > MATERIAL:
        said = (
            f"predictions are {excess:.2g} noise variances a reading worse than the stated noise "
            "allows, but no effect and no disturbance that depends on the motion explains it: the "
            "sensors may be noisier than stated"
        )
    else:
        said = "what the model predicts differs from the readings by their noise"
    return Judgement("adequate", (said,))


def _pinned(found: Found) -> list[Variable]:
    """Return the variables of named effects whose size is at an end of what is plausible.

    The size of an effect is its first knob. An end at which the size was in the model as given does
    not count.
    """
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
