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
from rig.sweep import AskedStudy, Share

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
    """The share of the cases that met the criterion, or passed the outer band."""
    inner: str = ""
    """The share of the cases that passed the inner band of a limit."""


def criteria_in_words(study: AskedStudy) -> list[AskedRow]:
    """Return the criteria in words, with the shares of the cases that met them."""
    return [
        AskedRow(criterion_in_words(each.criterion), each.motion or "all", of_share(each.met))
        for each in study.criteria
    ]


def limits_in_words(study: AskedStudy) -> list[AskedRow]:
    """Return the limits in words, with the shares of the cases that passed their bands."""
    return [
        AskedRow(
            limit_in_words(each.limit),
            each.motion or "all",
            _passed(each.outer, each.outer_times),
            _passed(each.inner, each.inner_times),
        )
        for each in study.limits
    ]


def figures_in_words(study: AskedStudy) -> list[tuple[str, int, str, str, str]]:
    """Return name, number of cases, median, 95 % quantile and greatest value of each figure.

    A figure that is known of no case is left out.
    """
    return [
        (
            each.name,
            each.cases,
            _value(each.median, each.unit),
            _value(each.p95, each.unit),
            _value(each.greatest, each.unit),
        )
        for each in study.figures
        if each.cases
    ]


def asked_lines(study: AskedStudy) -> Iterator[str]:
    """Yield what came of the criteria and limits of a sweep as lines for the terminal."""
    if study.passed is not None:
        yield f"  passed, by their criteria and limits: {of_share(study.passed)}"
    for row in criteria_in_words(study):
        yield f"  {row.what}{_where(row)}: met by {row.came}"
    for row in limits_in_words(study):
        inner = f"; inner band: {row.inner}" if row.inner else ""
        yield f"  limit {row.what}{_where(row)}: passed in {row.came or 'none'}{inner}"
    for name, cases, median, p95, greatest in figures_in_words(study):
        yield f"  {name} of {cases} cases: median {median}, 95 % {p95}, greatest {greatest}"


def _where(row: AskedRow) -> str:
    return "" if row.motion == "all" else f" ({row.motion})"


def _passed(share: Share | None, times: int) -> str:
    if share is None:
        return ""
    return of_share(share) + (f", {times} times" if times > share.count else "")


def _value(value: float, unit: str) -> str:
    if value == inf:
        return "never"
    return show(value, unit) if isfinite(value) else "not known"
