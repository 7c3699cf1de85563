"""Puts into words what came of the criteria, figures and limits of a sweep, and its control."""

from collections.abc import Iterator
from math import inf, isfinite
from typing import NamedTuple

from rig.configuration import (
    Sweep,
    SweptMotion,
    control_in_words,
    criterion_in_words,
    limit_in_words,
    show,
)
from rig.sweep import AskedStudy, FigureStudy, Share

from .words import of_share


class MotionWords(NamedTuple):
    """A motion of a sweep in words, for the page."""

    name: str
    setpoint: str
    """Its type, and how many segments it has."""
    share: str
    """Share of the cases that it has by its weight."""
    gain: str
    """Gain of the position loop, or between which gains it is drawn."""
    control: str
    """What the loop adds to gain times error."""


def motions_in_words(sweep: Sweep) -> Iterator[MotionWords]:
    """Yield each motion of a sweep in words, with the control by which the ram follows it."""
    total = sum(motion.share for motion in sweep.motions)
    for motion in sweep.motions:
        setpoint: str = motion.type
        if motion.sequence is not None:
            setpoint = f"{len(motion.sequence.stretches)} segments"
        share = f"{100.0 * motion.share / total:.3g} %"
        if motion.quantity != "position":
            yield MotionWords(motion.name, setpoint, share, "none", "the valve's command itself")
            continue
        law = control_in_words(sweep.control_of(motion)) or "nothing: gain times error alone"
        yield MotionWords(motion.name, setpoint, share, _gain(sweep, motion), law)


def _gain(sweep: Sweep, motion: SweptMotion) -> str:
    drawn = motion.values.get("position_gain")
    if drawn is None:
        return f"{sweep.gain_of(motion):g} V/m"
    low, high = drawn[0].support
    return f"{low:g} V/m" if low == high else f"{low:g} to {high:g} V/m, drawn"


class AskedRow(NamedTuple):
    """A criterion or limit in words, with what came of it."""

    what: str
    """The figure and its limits, or what is watched and its bands."""
    motion: str
    """The motion in whose cases it holds."""
    came: str
    """The share of the cases that met the criterion, or exceeded the outer band."""
    inner: str = ""
    """The share of the cases that exceeded the inner band of a limit."""


def criteria_in_words(study: AskedStudy) -> list[AskedRow]:
    """Return the criteria in words, with the shares of the cases that met them."""
    return [
        AskedRow(criterion_in_words(each.criterion), each.motion or "all", of_share(each.met))
        for each in study.criteria
    ]


def limits_in_words(study: AskedStudy) -> list[AskedRow]:
    """Return the limits in words, with the shares of the cases that exceeded their bands."""
    return [
        AskedRow(
            limit_in_words(each.limit),
            each.motion or "all",
            _exceeded(each.outer, each.outer_times),
            _exceeded(each.inner, each.inner_times),
        )
        for each in study.limits
    ]


class FigureWords(NamedTuple):
    """A figure over the cases of which it is known, in words."""

    name: str
    cases: int
    infinite: str
    """In how many of these cases it is infinite, with the words for it; empty if in none."""
    median: str
    p95: str
    """95 % quantile."""
    greatest: str


def figures_in_words(study: AskedStudy) -> list[FigureWords]:
    """Return each figure in words; one that is known of no case is left out."""
    return [
        FigureWords(
            each.name,
            each.cases,
            ", ".join(_infinite(each)),
            _value(each.median, each),
            _value(each.p95, each),
            _value(each.greatest, each),
        )
        for each in study.figures
        if each.cases
    ]


def _infinite(figure: FigureStudy) -> Iterator[str]:
    for count, value in ((figure.infinite, inf), (figure.minus_infinite, -inf)):
        if count:
            yield f"{_value(value, figure)} in {count}"


def asked_lines(study: AskedStudy) -> Iterator[str]:
    """Yield what came of the criteria and limits of a sweep as lines for the terminal."""
    if study.passed is not None:
        yield f"  passed, by their criteria and limits: {of_share(study.passed)}"
    for row in criteria_in_words(study):
        yield f"  {row.what}{_where(row)}: met by {row.came}"
    for row in limits_in_words(study):
        inner = f"; inner band: {row.inner}" if row.inner else ""
        yield f"  limit {row.what}{_where(row)}: exceeded in {row.came or 'none'}{inner}"
    for each in figures_in_words(study):
        infinite = f" ({each.infinite})" if each.infinite else ""
        yield (
            f"  {each.name} of {each.cases} cases{infinite}: median {each.median}, "
            f"95 % {each.p95}, greatest {each.greatest}"
        )


def _where(row: AskedRow) -> str:
    return "" if row.motion == "all" else f" ({row.motion})"


def _exceeded(share: Share | None, times: int) -> str:
    if share is None:
        return ""
    return of_share(share) + (f", {times} times" if times > share.count else "")


def _value(value: float, figure: FigureStudy) -> str:
    """Return a value of a figure in words; a settling time that is infinite is "never"."""
    if value == inf:
        return "never" if figure.figure == "settling" else "without bound"
    if value == -inf:
        return "below any bound"
    return show(value, figure.unit) if isfinite(value) else "not known"
