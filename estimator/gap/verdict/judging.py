"""This module gives the verdict and its reasons by rules, of which the first that applies decides.

What is named and what was discovered was chosen before (`choosing`), by how well it predicts. What
stays unexplained lowers the claim and does not erase it. How often the verdicts are right was
measured on hidden rigs (docs/gap.md, "Measured").
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

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


class Judgement(NamedTuple):
    """A verdict with its reasons in words."""

    verdict: Verdict
    reasons: list[str]


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
    def what(self) -> str:
        """Return the names of what is claimed, joined by "and"."""
        names = [named.effect for named in self.found.named]
        names += [
            f"a disturbance of the {each.addition.place}"
            + (f" that depends on {each.addition.of}" if each.addition.of else "")
            for each in self.discovered
        ]
        return " and ".join(names)


Rule = Callable[[Evidence], list[str]]
"""A rule returns its reasons in words where it applies, else an empty list."""


def judge(evidence: Evidence) -> Judgement:
    """Return the judgement of the first of `RULES` that applies; if none does, "adequate"."""
    for rule, verdict in RULES.items():
        reasons = rule(evidence)
        if reasons:
            return Judgement(verdict, reasons)
    said = "what the model predicts differs from the readings by their noise"
    if evidence.excess > MATERIAL:
        said = (
            f"predictions are {evidence.excess:.2g} noise variances a reading worse than the "
            "stated noise allows, but no effect and no disturbance that depends on the motion "
            "explains it: the sensors may be noisier than stated"
        )
    return Judgement("adequate", [said])


# Rules by which the recordings support no verdict


def another_rig(evidence: Evidence) -> list[str]:
    """Return a reason if "nothing changes" predicts better than the model.

    The recordings may come from another rig, or their channels may be mixed up. `SEVERAL` channels
    must be affected, because one may have a gap of its own. The rule does not apply if what is
    claimed, or a disturbance of one equation, explains more than `NOWHERE` of the excess.
    """
    if len(evidence.resting) < SEVERAL or _is_located(evidence):
        return []
    return [
        f"even refitted, the model predicts {', '.join(evidence.resting)} worse than 'nothing "
        "changes' would: another rig, or a channel in other units or swapped"
    ]


def too_much_at_once(evidence: Evidence) -> list[str]:
    """Return a reason if errors are large and nothing explains them.

    An excess that is not finite counts as too large.
    """
    excess = evidence.excess
    if np.isfinite(excess) and not (excess > TOO_MUCH and not _is_located(evidence)):
        return []
    return [
        f"predictions miss by {max(excess, 0.0) ** 0.5:.0f} times the noise, and no "
        "disturbance of a single equation explains it: too much is wrong at once; is this "
        "the rig that the model describes?"
    ]


def _is_located(evidence: Evidence) -> bool:
    claimed = evidence.found.named or evidence.discovered
    return evidence.located > NOWHERE or bool(claimed and evidence.found.explained > NOWHERE)


# Rules by which something acts


def missing_effect(evidence: Evidence) -> list[str]:
    """Return reasons if effects of the catalogue are named, and what they leave unexplained."""
    if not evidence.found.named:
        return []
    reasons = [
        f"with {named.effect} the squared prediction error falls by {named.per_reading:.3g} noise "
        f"variances a reading, {named.gain / named.bar:.0f} times what chance or a trifle would "
        f"give (z = {named.z:.0f})"
        for named in evidence.found.named
    ]
    return [*reasons, *_left(evidence)]


def discovered(evidence: Evidence) -> list[str]:
    """Return reasons if disturbances were discovered, and what they leave unexplained."""
    if not evidence.discovered:
        return []
    said = f"no effect of the catalogue explains what {evidence.what} does"
    return [said, *_left(evidence)]


def _left(evidence: Evidence) -> list[str]:
    """Return what stays unexplained, in words; empty if that is nothing that matters."""
    if not evidence.excess > MATERIAL:
        return []
    share = min(max(evidence.found.explained, 0.0), 1.0)
    words = f"{share:.1%} of the excess is explained by {evidence.what}"
    rest = f"{words}, the rest by nothing known: {evidence.excess:.2g} noise variances a reading"
    return [rest, *_stirred(evidence)]


def left_to_a_curve(evidence: Evidence) -> list[str]:
    """Return a reason if a free curve explains much of what is left.

    Nothing is claimed then, because no disturbance predicted what it was not fitted to.
    """
    free = evidence.rest[0].share * evidence.excess if evidence.rest else 0.0
    found = evidence.found
    given = found.given.cost / found.samples - found.floor
    if not (evidence.excess > MATERIAL and free > max(MATERIAL, TRIFLE * given)):
        return []
    curve = evidence.rest[0]
    return [
        "predictions stay worse than the sensors' noise allows; a disturbance of the "
        f"{curve.equation} that depends on {curve.region} would take away {curve.share:.0%} of "
        "that, but does not predict what it was not fitted to"
    ]


def goes_with_the_motion(evidence: Evidence) -> list[str]:
    """Return a reason if squared errors grow with the motion.

    A resonance, or something random, leaves errors of mean 0: no fitted curve shows them, but their
    squares do (`Unsettled.counts`).
    """
    return [
        f"{words}; no effect of the catalogue explains it, nor does noise of a sensor"
        for words in _stirred(evidence)
    ]


def _stirred(evidence: Evidence) -> list[str]:
    """Return in words how the errors of the worst channel go with the motion; empty if none do."""
    channels = [channel for channel in evidence.unsettled if channel.counts]
    if not channels:
        return []
    worst = max(channels, key=lambda channel: channel.stirred)
    top = int(np.argmax(worst.values))
    return [
        f"errors of {worst.channel} stay {worst.mean:.2g} predicted variances above the noise, "
        f"and it goes with the {worst.region}: {worst.values[top]:.2g} at {worst.at[top]:.3g} "
        f"{worst.unit}, {worst.values.min():.2g} where they are least"
    ]


def not_shown(evidence: Evidence) -> list[str]:
    """Return a reason if the model predicts held-out recordings too badly.

    The bound is `HELD_OUT`. Such a model is not adequate, but the motions fitted to do not show
    what it lacks.
    """
    if not evidence.held_out > HELD_OUT:
        return []
    return [
        "the recordings fitted to are predicted as well as their noise allows, those held "
        f"out are not, by {evidence.held_out:.2g} noise variances a reading: something is "
        "missing that the motions fitted to do not show; fit to motions like those held out"
    ]


RULES: Final[dict[Rule, Verdict]] = {
    another_rig: "inconclusive",
    too_much_at_once: "inconclusive",
    missing_effect: "missing_effect",
    discovered: "unknown_effect",
    left_to_a_curve: "unknown_effect",
    goes_with_the_motion: "unknown_effect",
    not_shown: "inconclusive",
}
"""The verdict of each rule that applies, in the order in which the rules are tried: first whether
there is anything to judge, then what is claimed, then what is left although nothing is claimed."""
