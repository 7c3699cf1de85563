"""What a sweep asks of its cases: which samples that needs, and the columns of the table it makes.

Figures are those of a campaign's test, computed by the same code from the samples of a case.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import Constant
from estimator.leaks import Decision
from faults import FOLLOWING_ERROR, CampaignTest, Criterion, OwnFigure, TestLimit, Verdict
from rig.configuration import (
    LATENCY,
    Sweep,
    SweptMotion,
    asked_column,
    criterion_in_words,
    figures_judged_twice,
    limit_label,
    met_column,
    show,
)
from rig.loop import LANE_READINGS
from rig.plant import TICK
from rig.runner.outcomes import Measures

from .crossing import Crossing, crossings_of

Array = NDArray[np.float64]

PASSED: Final = "passed"
LIMIT_PASSED: Final = "limit_passed"
LIMIT_AT: Final = "limit_at_s"
_OF_ERROR: Final = ("rms_error", "peak_error", "overshoot", "settling")
_OF_LEAK: Final = ("leak", LATENCY)
"""Figures that only a leak gives, so that criteria of them are not asked of healthy cases."""


class Asked(NamedTuple):
    """What is asked of the cases of one motion."""

    own: tuple[OwnFigure, ...] = ()
    """Figures and quantities that the sweep defines by expressions."""
    criteria: tuple[Criterion, ...] = ()
    """What figures must be for a case to pass."""
    limits: tuple[TestLimit, ...] = ()
    """Limits that a case should keep."""
    quantity: str = "position"
    """Whether the setpoint is a position in m or the valve's command in V."""
    judged_twice: frozenset[str] = frozenset()
    """Labels of the figures with several criteria, of which each has a column of its own."""

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels of the samples that are needed, each once."""
        wanted = [name for each in self.own for name in each.expression.channels]
        wanted += [each.channel for each in self.criteria if each.channel]
        if any(each.figure in _OF_ERROR for each in self.criteria):
            wanted.append(FOLLOWING_ERROR)
        for limit in self.limits:
            wanted += limit.expression.channels if limit.expression else [limit.watched]
        return tuple(dict.fromkeys(wanted))


def asked_of(sweep: Sweep, motion: SweptMotion) -> Asked:
    """Return what a sweep asks of the cases of a motion."""
    own = {each.name: each.expression for each in sweep.own_figures}
    limits = tuple(
        replace(each, expression=each.expression or own.get(each.watched)) for each in motion.limits
    )
    judged_twice = figures_judged_twice(each.criteria for each in sweep.motions)
    return Asked(sweep.own_figures, motion.criteria, limits, motion.quantity, judged_twice)


def readings_kept(asked: Sequence[Asked]) -> tuple[str, ...]:
    """Return which readings of a case must be kept for all that is asked, as in `LANE_READINGS`."""
    wanted = {name for each in asked for name in each.channels}
    if FOLLOWING_ERROR in wanted:
        wanted.add("position_m")
    return tuple(name for name in LANE_READINGS if name in wanted)


def columns_told(asked: Sequence[Asked]) -> dict[str, tuple[str, str]]:
    """Return the columns of the table that follow from what is asked: name -> (unit, about).

    Where nothing is asked there are none.

    Args:
        asked: what is asked of the cases of each motion.
    """
    told: dict[str, tuple[str, str]] = {}
    criteria = [(each, criterion) for each in asked for criterion in each.criteria]
    limits = [limit for each in asked for limit in each.limits]
    for own in asked[0].own if asked else ():
        if own.expression.is_number:
            told[asked_column("figure", own.name)] = own.unit, f"figure {own.expression.text}"
    for _, criterion in criteria:
        about = f"figure {criterion.label}"
        told[asked_column("figure", criterion.label)] = criterion.unit, about
    for each, criterion in criteria:
        about = f"1 if {_met_words(criterion, each)}, else 0"
        told[met_column(criterion, each.judged_twice)] = "", about
    for limit in limits:
        for band in limit.bands:
            about = f"how often the {band.name} band of {limit_label(limit)} was exceeded"
            told[asked_column(band.name, limit_label(limit))] = "", about
    if limits:
        told[LIMIT_PASSED] = "", "the first limit exceeded that calls for more than a warning"
        told[LIMIT_AT] = "s", "when it was exceeded, and a test would have ended"
    if criteria or limits:
        told[PASSED] = "", "1 if all criteria were met and no such limit was exceeded, else 0"
    return told


def _met_words(criterion: Criterion, asked: Asked) -> str:
    if criterion.label in asked.judged_twice:
        return f"{criterion_in_words(criterion)}, as asked"
    return f"{criterion.label} was as asked"


class Known(NamedTuple):
    """What the detector made of one case."""

    leak_m3_per_s: float
    """The leak's flow as estimated; NaN if it is not told."""
    latency_s: float
    """Time from the onset until the leak was named; NaN if it was not."""
    leaky: bool
    """Whether the case has a leak."""


def judged_case(
    asked: Asked, readings: Mapping[str, Array], setpoint: Array, known: Known
) -> dict[str, float | str]:
    """Return the columns of one case that follow from what is asked of it, by their names.

    Columns of other motions' cases are left out.

    Args:
        asked: what is asked.
        readings: reading -> samples (ticks,), SI, for the readings that are kept.
        setpoint: setpoint of each tick, m or V, (ticks,).
        known: what the detector made of the case.
    """
    channels = _channels(asked, readings, setpoint)
    own = {
        asked_column("figure", each.name): each.expression.of(channels)
        for each in asked.own
        if each.expression.is_number
    }
    criteria = _criteria_columns(asked, channels, known)
    crossings = [crossing for limit in asked.limits for crossing in crossings_of(limit, channels)]
    acted = [each for each in crossings if each.action != "warn"]
    first = min(acted, key=lambda each: each.at_s, default=None)
    found: dict[str, float | str] = {**own, **criteria, **_counted(asked, crossings)}
    if asked.limits:
        found[LIMIT_PASSED] = "" if first is None else in_words(first)
        found[LIMIT_AT] = nan if first is None else first.at_s
    met = [value for name, value in criteria.items() if name.startswith("met_")]
    if met or asked.limits:
        found[PASSED] = float(all(met) and first is None)
    return found


def _criteria_columns(
    asked: Asked, channels: Mapping[str, Array], known: Known
) -> dict[str, float]:
    """Return the figures of a case's criteria, and whether they were as asked, as columns.

    Criteria of a leak that the case does not have are left out.
    """
    measures = Measures(_test(asked), tuple(channels))
    measures.take(np.column_stack(list(channels.values())))
    decision = None
    if isfinite(known.leak_m3_per_s):
        decision = Decision("", leak_m3_per_s=known.leak_m3_per_s)
    values: dict[str, float] = {}
    met: dict[str, float] = {}
    for criterion, result in zip(asked.criteria, measures.results({}, decision), strict=True):
        if criterion.figure in _OF_LEAK and not known.leaky:
            continue
        value = known.latency_s if criterion.figure == LATENCY else result.value
        values[asked_column("figure", criterion.label)] = value
        column = met_column(criterion, asked.judged_twice)
        met[column] = float(criterion.low <= value <= criterion.high)
    return values | met


def _counted(asked: Asked, crossings: Sequence[Crossing]) -> dict[str, float]:
    """Return how often a case passed each band of its limits, as columns."""
    counts: dict[str, float] = {}
    for limit in asked.limits:
        for band in limit.bands:
            passed = sum(each.limit is limit and each.band == band.name for each in crossings)
            counts[asked_column(band.name, limit_label(limit))] = float(passed)
    return counts


def in_words(crossing: Crossing) -> str:
    """Return what was exceeded in words: "following_error_m above 5 mm: ramp_down"."""
    word = "above" if crossing.value > crossing.end else "below"
    end = show(crossing.end, crossing.limit.unit)
    return f"{limit_label(crossing.limit)} {word} {end}: {crossing.action}"


def _channels(asked: Asked, readings: Mapping[str, Array], setpoint: Array) -> dict[str, Array]:
    """Return channel -> samples (ticks,) of a case, in SI, with the time first."""
    name = "setpoint_m" if asked.quantity == "position" else "setpoint_V"
    channels = {"time_s": np.arange(setpoint.size) * TICK, name: setpoint, **readings}
    if FOLLOWING_ERROR in asked.channels and name == "setpoint_m":
        channels[FOLLOWING_ERROR] = np.abs(setpoint - readings["position_m"])
    lacking = np.full(setpoint.size, nan)
    return channels | {each: lacking for each in asked.channels if each not in channels}


def _test(asked: Asked) -> CampaignTest:
    """Return a test that asks for the same figures; all else of it is not looked at."""
    return CampaignTest(
        name="",
        test_name="",
        duration_s=0.0,
        start_position_m=0.0,
        settle_s=0.0,
        setpoint=Constant(0.0),
        load=None,
        faults=(),
        expect=Verdict.HEALTHY,
        repeat=1,
        seed=0,
        own_figures=asked.own,
        criteria=asked.criteria,
    )
