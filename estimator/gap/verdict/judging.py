"""This module gives the verdict and its reasons by rules, of which the first that applies decides.

What is named and what was discovered was chosen before (`choosing`), by how well it predicts. What
stays unexplained lowers the claim and does not erase it. How often the verdicts are right was
measured on hidden rigs (docs/gap.md, "Measured").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.prediction import Curve, Verdict
from estimator.gap.search import HELD_OUT, MATERIAL, Discovery, Found

from .unsettled import Unsettled

SEVERAL: Final = 2
"""Least number of channels that the model must predict worse than the assumption that nothing
changes. A single channel may have a gap of its own."""
TOO_MUCH: Final = 25.0
"""Excess in noise variances, five standard deviations. One missing part may leave more only if it
is located. This bound was chosen."""
NOWHERE: Final = 0.3
"""Part of an excess that must be explained for the recordings to be those of this rig. It is more
than each equation would explain if force, both flows and the spool were wrong alike."""
TRIFLE: Final = 0.02
"""Part of the excess of the model as given that a curve must take away to count where it does not
predict what it was not fitted to: twice the part by which the form of an effect may be wrong."""


@dataclass(frozen=True)
class Judgement:
    """A verdict with its reasons in words."""

    verdict: Verdict
    reasons: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """Everything that a verdict depends on.

    Attributes:
        found: finding with all that is claimed.
        discovered: disturbances that were discovered beside the named effects, or in their place.
        rest: disturbances that would explain what is left, the best first.
        located: part of the excess of the refitted model that the best disturbance of one equation
            explains.
        resting: channels that the model with all that is claimed predicts worse than the assumption
            that nothing changes.
        unsettled: for each channel, the part of its errors that depends on the motion, with all
            that is claimed.
        held_out: excess in squared error on the held-out recordings, in variances per reading.
    """

    found: Found
    discovered: Sequence[Discovery]
    rest: Sequence[Curve]
    located: float
    resting: Sequence[str]
    unsettled: Sequence[Unsettled]
    held_out: float

    @property
    def excess(self) -> float:
        """Return the cost that the finding leaves above the floor, in variances per reading."""
        return self.found.fitted.cost / self.found.samples - self.found.floor

    @property
    def explained(self) -> float:
        """Return the part of the excess that all that is claimed takes away."""
        return self.found.explained

    @property
    def what(self) -> str:
        """Return the names of what is claimed, joined by "and"."""
        names = [named.effect for named in self.found.named]
        names += [
            f"a disturbance of the {each.addition.place}"
            + (f" that depends on {each.addition.of}" if each.addition.of else "")
            for each in self.discovered
        ]
        return " and ".join(names)


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
    must be affected, because one may have a gap of its own. The rule does not apply if what is
    claimed, or a disturbance of one equation, explains more than `NOWHERE` of the excess.
    """
    if len(evidence.resting) < SEVERAL or _is_located(evidence):
        return None
    return Judgement(
        "inconclusive",
        (
            f"even refitted, the model predicts {', '.join(evidence.resting)} worse than 'nothing "
            "changes' would: another rig, or a channel in other units or swapped",
        ),
    )


def too_much_at_once(evidence: Evidence) -> Judgement | None:
    """Judge "inconclusive" if errors are large and nothing explains them; else return None.

    An excess that is not finite counts as too large.
    """
    excess = evidence.excess
    if np.isfinite(excess) and not (excess > TOO_MUCH and not _is_located(evidence)):
        return None
    return Judgement(
        "inconclusive",
        (
            f"predictions miss by {max(excess, 0.0) ** 0.5:.0f} times the noise, and no "
            "disturbance of a single equation explains it: too much is wrong at once; is this "
            "the rig that the model describes?",
        ),
    )


def _is_located(evidence: Evidence) -> bool:
    claimed = evidence.found.named or evidence.discovered
    return evidence.located > NOWHERE or bool(claimed and evidence.explained > NOWHERE)


# Rules by which something acts


def missing_effect(evidence: Evidence) -> Judgement | None:
    """Judge "missing_effect" if effects of the catalogue are named; else return None."""
    if not evidence.found.named:
        return None
    reasons = [
        f"with {named.effect} the squared prediction error falls by {named.per_reading:.3g} noise "
        f"variances a reading, {named.gain / named.bar:.0f} times what chance or a trifle would "
        f"give (z = {named.z:.0f})"
        for named in evidence.found.named
    ]
    return Judgement("missing_effect", (*reasons, *_left(evidence)))


def discovered(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if disturbances were discovered; else return None."""
    if not evidence.discovered:
        return None
    return Judgement(
        "unknown_effect",
        (
            f"no effect of the catalogue explains what {evidence.what} does",
            *_left(evidence),
        ),
    )


def _left(evidence: Evidence) -> list[str]:
    """Return what stays unexplained, in words; empty if that is nothing that matters."""
    if not evidence.excess > MATERIAL:
        return []
    share = min(max(evidence.explained, 0.0), 1.0)
    words = f"{share:.1%} of the excess is explained by {evidence.what}"
    said = [f"{words}, the rest by nothing known: {evidence.excess:.2g} noise variances a reading"]
    stirred = [channel for channel in evidence.unsettled if channel.counts]
    if stirred:
        worst = max(stirred, key=lambda channel: channel.stirred)
        said.append(_goes_with(worst))
    return said


def left_to_a_curve(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if a free curve explains much of what is left; else return None.

    Nothing is claimed then, because no disturbance predicted what it was not fitted to.
    """
    free = evidence.rest[0].share * evidence.excess if evidence.rest else 0.0
    found = evidence.found
    given = found.given.cost / found.samples - found.floor
    if not (evidence.excess > MATERIAL and free > max(MATERIAL, TRIFLE * given)):
        return None
    curve = evidence.rest[0]
    return Judgement(
        "unknown_effect",
        (
            "predictions stay worse than the sensors' noise allows; a disturbance of the "
            f"{curve.equation} that depends on {curve.region} would take away {curve.share:.0%} of "
            "that, but does not predict what it was not fitted to",
        ),
    )


def goes_with_the_motion(evidence: Evidence) -> Judgement | None:
    """Judge "unknown_effect" if squared errors grow with the motion; else return None.

    A resonance, or something random, leaves errors of mean 0: no fitted curve shows them, but their
    squares do (`Unsettled.counts`).
    """
    stirred = [channel for channel in evidence.unsettled if channel.counts]
    if not stirred:
        return None
    worst = max(stirred, key=lambda channel: channel.stirred)
    return Judgement(
        "unknown_effect",
        (
            f"{_goes_with(worst)}; no effect of the catalogue explains it, nor does noise of a "
            "sensor",
        ),
    )


def _goes_with(worst: Unsettled) -> str:
    top = int(np.argmax(worst.values))
    return (
        f"errors of {worst.channel} stay {worst.mean:.2g} predicted variances above the noise, "
        f"and it goes with the {worst.region}: {worst.values[top]:.2g} at {worst.at[top]:.3g} "
        f"{worst.unit}, {worst.values.min():.2g} where they are least"
    )


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
    missing_effect,
    discovered,
    left_to_a_curve,
    goes_with_the_motion,
    not_shown,
)
"""The rules, in the order in which they are tried: first whether there is anything to judge, then
what is claimed, then what is left although nothing is claimed."""


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
