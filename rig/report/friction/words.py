"""Puts friction into words: parameters with intervals, changes, and what was not identified."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import floor, log10
from typing import Final

from estimator.friction import CHANGE_PROBABILITY, FrictionCurve, FrictionEstimate, friction_changes

INTERVAL: Final = 1.96
"""Half the width of a 95 % interval, in standard errors."""


@dataclass(frozen=True)
class FrictionRun:
    """The friction of one recording.

    Attributes:
        recording: the recording as the user named it.
        name: name of its test, or of its file if it names no test.
        started: when it was begun, UTC; None if that is not recorded.
        curve: the identified friction.
    """

    recording: str
    name: str
    started: str | None
    curve: FrictionCurve


def in_words(parameter: str) -> str:
    """Return a parameter's name with spaces in place of underscores."""
    return parameter.replace("_", " ")


def shown(estimate: FrictionEstimate) -> str:
    """Return an estimate as text, value ± half the width of its 95 % interval, without the unit.

    The text is "not shown" if the parameter was not identified.
    """
    if estimate.value is None or estimate.standard_error is None:
        return "not shown"
    half = INTERVAL * estimate.standard_error
    decimals = max(0, 1 - floor(log10(half))) if half > 0.0 else 0
    return f"{estimate.value:.{decimals}f} \u00b1 {half:.{decimals}f}"


def needs_in_words(curve: FrictionCurve) -> Iterator[str]:
    """Yield, for each motion that was missing, the parameters that it would have identified."""
    for need in dict.fromkeys(each.needs for each in curve.estimates.values() if each.needs):
        names = [in_words(name) for name, each in curve.estimates.items() if each.needs == need]
        yield f"{', '.join(names)}: not identifiable; needs {need}"


def changes_in_words(runs: Sequence[FrictionRun]) -> Iterator[str]:
    """Yield lines on how friction changed from the first recording to the last.

    Nothing is yielded for a single recording.
    """
    if len(runs) < 2:
        return
    changes = friction_changes(runs[0].curve, runs[-1].curve)
    if not changes:
        yield "change from first to last: not known, they show no parameter in common"
        return
    rate = f"{100.0 * CHANGE_PROBABILITY:g} %"
    yield f"change from first to last (false alarms: {rate} of unchanged pairs at most):"
    units = {name: each.unit for name, each in runs[0].curve.estimates.items()}
    for change in changes:
        result = "changed" if change.significant else "no change shown"
        difference = f"{change.difference:+.3g} {units[change.name]}"
        yield f"{in_words(change.name)}: {difference}, z = {change.score:+.1f}, {result}"
