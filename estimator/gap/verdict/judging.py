"""The verdict and its reasons: rules in order, of which the first that applies decides.

Some bounds are derived; the others were chosen, which their docstrings say. How often the verdicts
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
Chosen."""
SEVERAL: Final = 2
"""Channels that must be predicted worse than by resting: a single one may have a gap of its own."""
TOO_MUCH: Final = 25.0
"""Noise variances of excess that are more than one missing effect leaves in every equation: five
standard deviations. Chosen."""
NOWHERE: Final = 0.3
"""Part of an excess that the best disturbance of a single equation must explain: more than its
share if force, both flows and the spool were wrong alike."""
FREE: Final = 0.05
"""Part of the excess that a free curve may still take away once the whole answer is named.
Chosen."""
PINNED: Final = 1e-3
"""Part of a size's plausible range: a size nearer than that to one of its ends would go further if
it might. Chosen: far less than sizes are known to."""
AHEAD: Final = 5.0
"""Noise variances of gap over the horizon held out that are too much to be left, where names took
less than half away or are as many as may be. Chosen with blind trials in sight (docs/gap.md)."""
SURE: Final = 2.0
"""Standard deviations by which a gap must be above that bound: where a ram sticks and slips, twins
of the same rig differ by several noise variances."""
HALVED: Final = 0.5
"""Part of the gap over the horizon that names must take away, where more than `AHEAD` is left.
Chosen with it."""
SHOWN: Final = 1.0
"""Noise variances a reading held out that what is missing makes, from which it shows there: ten
times what is too much to be left."""


@dataclass(frozen=True)
class Judgement:
    """A verdict with its reasons in words."""

    verdict: Verdict
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """What a verdict follows from.

    Attributes:
        found: by the search, confirmed.
        rest: disturbances that would explain what is left, best first.
        located: part of the excess that a disturbance of one equation explains.
        resting: channels predicted worse than "nothing changes" would be, with all that was found.
        unsettled: of each channel, what of its errors goes with the motion with all that was found.
        held_out: excess in squared error of the recordings held out, in variances a reading.
        held_out_before: the same, with nuisances refitted only.
        ahead: gap over the horizon held out, of the model as given and with all that was found, in
            noise variances; NaN if nothing was named.
        scatter: of the gap that is left, by chance: one standard deviation.
        worse: why the model with all that was named is worse than the one given, in words; None if
            it is not.
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
        """What all that was found leaves above the floor, in variances a reading."""
        return self.found.fitted.cost / self.found.samples - self.found.floor

    @property
    def whole(self) -> bool:
        """Whether what was named takes away enough to be the whole answer."""
        return bool(self.found.named) and not self.found.explained < EXPLAINED

    @property
    def borne_out(self) -> bool:
        """Whether a motion held out shows what is missing, and names predict it.

        That outweighs a motion that they were fitted to.
        """
        return self.held_out_before > SHOWN and self.held_out < LEFT * self.held_out_before

    @property
    def names(self) -> str:
        """The named effects, in words."""
        return " and ".join(named.effect for named in self.found.named)


Rule = Callable[[Evidence], Judgement | None]
"""Returns the verdict where the rule applies, else None."""


def judge(evidence: Evidence) -> Judgement:
    """Return the verdict of the first of `RULES` that applies, else that the model is adequate."""
    judgements = (rule(evidence) for rule in RULES)
    return next((found for found in judgements if found is not None), _adequate(evidence.excess))


# Rules by which the recordings support no verdict


def another_rig(evidence: Evidence) -> Judgement | None:
    """Refuse recordings that are predicted worse than by resting: of another rig, or mixed up.

    `SEVERAL` channels must be, for one may have a gap of its own. What one equation lacks, by more
    than `NOWHERE`, is of this rig, however badly it is predicted without.
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
    """Refuse predictions that miss by so much that no single effect can be the cause.

    More than `TOO_MUCH` is left, names are not the whole answer, and no equation alone has more
    than `NOWHERE` of it. Nor does a cost tell anything that is not finite.
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


# Rules by which something acts that nothing was named for, or that names only stand in for


def left_to_a_curve(evidence: Evidence) -> Judgement | None:
    """Take what a free curve explains, and names do not, for an effect that is unknown.

    A curve costs no physics: names that leave it much to explain are not the cause. It counts from
    `MATERIAL` on, the least that matters to a prediction, where names are not the whole answer
    (`EXPLAINED`); where they are, from the part `FREE` of what there was before them.
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
    """Take errors that grow where the rig is stirred for an effect that is unknown.

    No curve tells of a resonance or of chance, whose mean is nought; `unsettled` gives the test and
    its bounds. Names that a motion held out bears out stand all the same.
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
    """Name no effect whose size is at an end of what is plausible (`PINNED`) and leaves much.

    It would go further if it might: it stands in for something else. Much is `MATERIAL`, the least
    that matters. A size that a motion held out bears out is the cause all the same.
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
    """Name nothing that explains the recordings fitted to, but not those held out.

    Held out, as much must be explained as in those fitted to (`EXPLAINED`), unless no more is left
    than a model has that lacks nothing (`HELD_OUT`).
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
    """Name nothing that lowers one-step errors and leaves the gap over the horizon open.

    More is left than `AHEAD`, beyond `SURE` times what twins scatter by, and either that is more
    than half (`HALVED`) of what there was, or as many effects are named as may be, which still do
    not suffice.
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
    """Name nothing that makes a model worse than the one given; `keeping` gives the bounds."""
    if not evidence.found.named or not evidence.worse:
        return None
    said = f"{evidence.names} would lower one-step errors, but {evidence.worse}; nothing is named"
    return Judgement("unknown_effect", (said,))


# Rules by which the answer is known, or known to be missing


def missing_effect(evidence: Evidence) -> Judgement | None:
    """Name what earned its place in the search, since no rule before speaks against it."""
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
    """Call no model adequate that predicts the recordings held out worse than the noise allows.

    The bound is `HELD_OUT`: what is missing does not show in the motions fitted to.
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
"""In this order: first whether there is anything to judge, then what speaks against names."""


def _adequate(excess: float) -> Judgement:
    """Return that nothing is missing, from what is left in variances a reading."""
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
