"""The tables of a test: its segments, the criteria by which it passes, and its limits."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from math import isfinite
from typing import Any, Final

import numpy as np

from rig.configuration import show, show_alike
from rig.recording import Recording
from rig.runner.outcomes import LimitPassed, SegmentRun, TestOutcome

_MOST_ROWS: Final = 60
"""Most segments that a page lists, three turns of a loop of twenty: a longer table is not read."""


@dataclass(frozen=True)
class SegmentRow:
    """One segment of a test, as texts.

    Attributes:
        segment: the segment.
        valley, peak: least and greatest position.
        rms_error, peak_error: rms and greatest distance between setpoint and position; empty in
            open loop.
    """

    segment: SegmentRun
    valley: str
    peak: str
    rms_error: str
    peak_error: str


@dataclass(frozen=True)
class LimitRow:
    """One band of a limit, as texts.

    Attributes:
        of: whose limit it is, "test" or "rig".
        watched: what is watched, and where or over which time.
        band: the band's name and ends.
        action: what is done beyond it.
        first: when it was passed first, since when the value was beyond, and its value; empty if it
            was not passed.
        times: how often it was passed.
        not_judged: why it was not judged; empty if it was.
    """

    of: str
    watched: str
    band: str
    action: str
    first: str = ""
    times: int = 0
    not_judged: str = ""


def segment_rows(test: TestOutcome, recording: Recording) -> tuple[tuple[SegmentRow, ...], int]:
    """Return the rows of a test's segments and of the whole test, and how many more there are.

    Args:
        test: the test's outcome.
        recording: its recording; a channel that it lacks leaves its texts empty.
    """
    shown = test.segments[:_MOST_ROWS]
    whole = SegmentRun("whole test", "", 0.0, test.recorded_s, ended_early=False)
    rows = tuple(_segment_row(each, recording) for each in (*shown, whole))
    return rows, len(test.segments) - len(shown)


def _segment_row(segment: SegmentRun, recording: Recording) -> SegmentRow:
    time_s = recording.time_s
    here = (time_s >= segment.begin_s - 1e-6) & (time_s < segment.end_s - 1e-6)
    lacking = np.full(len(time_s), np.nan)
    position = recording.channels.get("position_m", lacking)[here]
    error = np.abs(recording.channels.get("setpoint_m", lacking)[here] - position)
    position, error = position[np.isfinite(position)], error[np.isfinite(error)]
    return SegmentRow(
        segment,
        show(float(position.min()), "m") if position.size else "",
        show(float(position.max()), "m") if position.size else "",
        show(float(np.sqrt(np.mean(np.square(error)))), "m") if error.size else "",
        show(float(error.max()), "m") if error.size else "",
    )


def limit_rows(test: TestOutcome, metadata: Mapping[str, Any]) -> tuple[LimitRow, ...]:
    """Return a row for each band of a test's limits, and for each limit of the rig that was passed.

    Args:
        test: the test's outcome.
        metadata: metadata of its recording, which lists its limits; those of an older one may not.
    """
    rows = list(_configured(metadata))
    unjudged = {(each.watched, each.each, each.during): each.why for each in test.limits_not_judged}
    found = []
    for row in rows:
        watched = row["watched"]
        passed = [
            each
            for each in test.limits
            if (each.of, each.watched, each.band) == ("test", watched, row["band"])
            and each.each == row["each"]
            and each.limit in (row["low"], row["high"])
        ]
        why = unjudged.get((watched, row["each"], row["during"]), "")
        found.append(replace(_row("test", row, passed), not_judged=why))
    told = {(row["watched"], row["each"], row["band"]) for row in rows}
    others: dict[tuple[str, str, str, float], list[LimitPassed]] = {}
    for each in test.limits:
        if each.of == "rig" or (each.watched, each.each, each.band) not in told:
            others.setdefault((each.of, each.watched, each.each, each.limit), []).append(each)
    for (of, watched, kind, limit), passed in others.items():
        first = passed[0]
        above = first.value > limit
        row = {
            "watched": watched, "where": f" of each {kind}" if kind else "", "band": first.band,
            "low": None if above else limit, "high": limit if above else None,
            "action": first.action, "unit": first.unit,
        }  # fmt: skip
        found.append(_row(of, row, passed))
    return tuple(found)


def _configured(metadata: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    test = metadata.get("test")
    limits = test.get("limits") if isinstance(test, Mapping) else None
    for limit in limits or ():
        kind = limit.get("each") or ""
        where = f" of each {kind}" if kind else ""
        where += f" over {limit['over_s']:g} s" if limit.get("over_s") else ""
        where += f" for {limit['for_s']:g} s" if limit.get("for_s") else ""
        where += f", in {limit['during']}" if limit.get("during") else ""
        inner = limit.get("inner_low"), limit.get("inner_high")
        outer = limit.get("low"), limit.get("high")
        for band, ends, action in (("inner", inner, "warn"), ("outer", outer, limit["action"])):
            if ends != (None, None):
                yield {
                    "watched": limit["watched"], "each": kind, "where": where, "band": band,
                    "low": ends[0], "high": ends[1], "action": action, "unit": limit["unit"],
                    "during": limit.get("during") or "",
                }  # fmt: skip


def _row(of: str, row: Mapping[str, Any], passed: list[LimitPassed]) -> LimitRow:
    ends = (("below", row["low"]), ("above", row["high"]))
    # In the unit of the value beside it.
    beside = [passed[0].value] if passed else []
    band = " or ".join(
        f"{word} {show_alike((end, *beside), row['unit'])[0]}"
        for word, end in ends
        if end is not None
    )
    first = ""
    if passed:
        earliest = passed[0]
        since = f", since {earliest.since_s:.3f} s" if isfinite(earliest.since_s) else ""
        if earliest.each:
            since = f", of the {earliest.each} from {earliest.since_s:.3f} s"
        first = f"{earliest.value_words} at {earliest.at_s:.3f} s{since}"
    watched, action = row["watched"] + row["where"], row["action"].replace("_", " ")
    return LimitRow(of, watched, f"{row['band']}: {band}", action, first, len(passed))
