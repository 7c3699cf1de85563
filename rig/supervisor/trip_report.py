"""The log of a session, and the trip report that is made from it.

The report holds the first-out cause, the steps of the trip, and the rig's last seconds.
"""

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import count
from math import nan
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.configuration import Rig, show
from rig.io import ChannelLimit
from rig.loop import (
    Action,
    Board,
    Cause,
    RingReader,
    RungPassed,
    TripError,
    Word,
    explain,
    latest_passings,
)
from rig.plant import TICK
from rig.recording import Recording, unit_of, write_csv
from rig.supervisor.processes import STEPS, Driven, News, loop_channel, stage_times, trips_of
from rig.surviving import failure

Array = NDArray[np.float64]
Say = Callable[[str], None]
"""A function that takes a line or sentence for the operator or the journal."""

SCHEMA: Final = "rig-trip"
_UNWRITTEN: Final = "the trip report cannot be written"
LAST_S: Final = 2.0
"""Length in s of the last samples of all channels that a trip report holds."""
LAST_NEWS_S: Final = 0.2
"""Time in s for which a trip report waits for reports of slow drivers after everything is safe."""
_UNCONFIRMED: Final = {
    "valve null": ("loop process", Cause.NULL_NOT_CONFIRMED),
    "bypass shut": ("field process", Cause.BYPASS_NOT_SHUT),
    "pump unloaded": ("field process", Cause.PUMP_NOT_UNLOADED),
}
"""By step of a trip: the process to which the device should confirm it, and what it means that
neither that process nor the supervisor got a confirmation."""


@dataclass(frozen=True)
class TripReport:
    """A report with all that is known of one trip.

    Attributes:
        trips: part that tripped -> (cause, time), CLOCK_MONOTONIC in ns; the first one first.
        confirmations: step of the trip ("valve null", "bypass shut", "pump unloaded") -> when the
            device confirmed it to the process that drives it, CLOCK_MONOTONIC in ns; 0 or less if
            it never did.
        notes: who did or asked for what, in order of time.
        channels: names of the rows' columns, `time_s` first.
        rows: float64 (n, columns), the last rows of the loop; may be empty.
        channel: the channel that the loop's cause concerns, one of `FAST_INPUTS`; empty if none.
        limits: the limits that the loop judged: those of the rig, then those of the test.
        of_test: how many of them are the test's.
        passed: which of them were passed since the test began, the oldest first.
        driven: reports on parts that another master drove out of their safe state.
        made_safe: step of the trip -> when the device confirmed it to the supervisor, by a
            connection of its own, CLOCK_MONOTONIC in ns.
    """

    trips: Mapping[str, tuple[Cause, int]]
    confirmations: Mapping[str, int]
    notes: Sequence[News]
    channels: tuple[str, ...]
    rows: Array
    channel: str = ""
    limits: Sequence[ChannelLimit] = ()
    driven: Sequence[Driven] = ()
    of_test: int = 0
    passed: Sequence[RungPassed] = ()
    made_safe: Mapping[str, int] = field(default_factory=dict)

    @property
    def first(self) -> tuple[str, Cause, int]:
        """The first-out cause: who tripped first, the cause, the time (CLOCK_MONOTONIC, ns)."""
        who = next(iter(self.trips))
        return who, *self.trips[who]

    @property
    def concerned(self) -> str:
        """The channel that the first-out cause concerns; empty if it concerns none.

        Only a cause of the loop concerns a channel.
        """
        return self.channel if self.first[0] == "loop" else ""

    @property
    def value(self) -> float:
        """The last value, not NaN, of the `concerned` channel up to the loop's trip, SI.

        It is NaN if the cause concerns no channel, or the rows hold no value of it.
        """
        if self.concerned not in self.channels:
            return nan
        values = self.rows[:, self.channels.index(self.concerned)]
        if "action" in self.channels:
            tripped = np.flatnonzero(self.rows[:, self.channels.index("action")] >= Action.TRIP)
            values = values[: tripped[0] + 1] if tripped.size else values
        return last_known(values)

    @property
    def limit(self) -> float:
        """The trip limit that the `concerned` channel exceeded, SI; NaN if the cause is no limit.

        If the channel has several trip limits, it is the tightest one.
        """
        concerned = (self.concerned, "trip")
        rungs = [rung for rung in self.limits if (rung.channel, rung.action) == concerned]
        if self.first[1] is Cause.LIMIT_LOW:
            return max((rung.low for rung in rungs), default=nan)
        if self.first[1] is Cause.LIMIT_HIGH:
            return min((rung.high for rung in rungs), default=nan)
        return nan

    @property
    def sentence(self) -> str:
        """The first-out cause in words, with the channel's value and limit as far as known."""
        text = explain(self.first[1], self.concerned).sentence
        unit = unit_of(self.concerned)
        if not unit or not np.isfinite(self.value):
            return text
        text += f": {show(self.value, unit)}"
        return text + (f", limit {show(self.limit, unit)}" if np.isfinite(self.limit) else "")

    def lines(self) -> list[str]:
        """Return the report as lines for the terminal, the first-out cause first."""
        who, cause, at_ns = self.first
        lines = [f"tripped by the {who}: {self.sentence}", f"  remedy: {explain(cause).remedy}"]
        lines += [f"  {self._confirmation_in_words(what)}" for what in self.confirmations]
        for found in self.driven:
            first, last = _after(found.first_ns, at_ns), _after(found.last_ns, at_ns)
            span = f"{first} to {last}" if found.times > 1 else first
            # Whether it obeyed is not known here: where it did not, a note below says so.
            lines.append(f"  {found.sentence}, {span}; its safe state was commanded each time")
        for other, (reason, when) in list(self.trips.items())[1:]:
            lines.append(f"  then the {other} {_after(when, at_ns)}: {explain(reason).sentence}")
        lines += [f"  {self._passed_in_words(each)}" for each in self.passed]
        for name, stage in stage_times(self.rows, self.channels).items():
            figures = ", ".join(f"{key} {1e6 * value:.0f} us" for key, value in stage.items())
            lines.append(f"  {name.removesuffix('_s')}: {figures}")
        lines += [f"  {_after(note.at_ns, at_ns)} {note.who}: {note.text}" for note in self.notes]
        return lines

    def _confirmation_in_words(self, step: str) -> str:
        """Return when a step of the trip was confirmed, and to whom; the remedy if it was not."""
        _, _, at_ns = self.first
        confirmed_ns = self.confirmations[step]
        if confirmed_ns > 0:
            return f"{step} confirmed {_after(confirmed_ns, at_ns)}"
        process, cause = _UNCONFIRMED[step]
        if step in self.made_safe:
            when = _after(self.made_safe[step], at_ns)
            return f"{step} NOT CONFIRMED to the {process}, but to the supervisor {when}"
        return f"{step} NOT CONFIRMED: {explain(cause).remedy}"

    def _whose(self, rung: int) -> str:
        return "test" if rung >= len(self.limits) - self.of_test else "rig"

    def _passed_in_words(self, passed: RungPassed) -> str:
        limit, at_s = self.limits[passed.rung], passed.tick * TICK
        above = passed.value > limit.high
        unit = unit_of(limit.channel)
        end = show(limit.high if above else limit.low, unit)
        return (
            f"limit of the {self._whose(passed.rung)}: {limit.channel} "
            f"{show(passed.value, unit)} {'above' if above else 'below'} {end} at {at_s:.3f} s, "
            f"since {max(at_s - limit.for_s, 0.0):.3f} s: {limit.action}"
        )

    def _limits(self) -> list[dict[str, Any]]:
        """Return every limit as JSON values, each with its latest passing, if any.

        Times of passings are in s of the test.
        """
        latest = {each.rung: each for each in self.passed}
        found = []
        for rung, limit in enumerate(self.limits):
            passed = latest.get(rung)
            found.append(
                {
                    "of": self._whose(rung),
                    "channel": limit.channel,
                    "low": _finite(limit.low),
                    "high": _finite(limit.high),
                    "for_s": limit.for_s,
                    "action": limit.action,
                    "passed": passed
                    and {
                        "value": _finite(passed.value),
                        "at_s": passed.tick * TICK,
                        "since_s": max(passed.tick * TICK - limit.for_s, 0.0),
                    },
                }
            )
        return found

    def document(self) -> dict[str, Any]:
        """Return the report as JSON values, without its rows.

        Times are in s after the first trip; None for a time that is not known, and for a value that
        is not finite. Only `time`, that of the first trip, is a date and time (UTC, ISO 8601).
        """
        who, cause, at_ns = self.first
        wall_s = 1e-9 * (time.time_ns() - time.monotonic_ns() + at_ns)

        def after_s(when: int) -> float | None:
            return 1e-9 * (when - at_ns) if when > 0 else None

        return {
            "schema": SCHEMA,
            "time": datetime.fromtimestamp(wall_s, UTC).isoformat(timespec="milliseconds"),
            "by": who,
            "cause": cause.name,
            "sentence": self.sentence,
            "remedy": explain(cause).remedy,
            "channel": self.concerned or None,
            "value": _finite(self.value),
            "limit": _finite(self.limit),
            "limits": self._limits(),
            "trips": [
                {"by": name, "cause": reason.name, "after_s": after_s(when)}
                for name, (reason, when) in self.trips.items()
            ],
            "confirmations": [
                {
                    "what": what,
                    "after_s": after_s(when),
                    "to_supervisor_after_s": after_s(self.made_safe.get(what, 0)),
                }
                for what, when in self.confirmations.items()
            ],
            "driven_by_another_master": [
                {
                    "part": found.part,
                    "what": found.text,
                    "times": found.times,
                    "first_after_s": after_s(found.first_ns),
                    "last_after_s": after_s(found.last_ns),
                    "brought_back_by": found.who,
                }
                for found in self.driven
            ],
            "stages_s": stage_times(self.rows, self.channels),
            "notes": [
                {"after_s": after_s(note.at_ns), "who": note.who, "what": note.text}
                for note in self.notes
            ],
        }


def last_known(values: Array) -> float:
    """Return the last finite one of the values, (n,); NaN if there is none."""
    known = values[np.isfinite(values)]
    return float(known[-1]) if known.size else nan


def write_trip_report(report: TripReport, directory: Path, path: Path | None = None) -> Path:
    """Write a report as `trip-<n>.json`, `.txt` and `.csv` (the last rows); return the JSON's path.

    Each file is written in one step, the largest last, as a disk may be almost full. There is no
    `.csv` for a report without rows.

    Args:
        report: the report.
        directory: the folder; the files get the first free number, unless `path` is given.
        path: path of an earlier version of the report, which is replaced; None if there is none.

    Raises:
        OSError: the folder cannot be written to.
    """
    numbered = (directory / f"trip-{number}.json" for number in count(1))
    path = path or next(each for each in numbered if not each.exists())
    document = json.dumps(report.document(), indent=2, allow_nan=False) + "\n"
    text = "\n".join(report.lines()) + "\n"
    _write(path, lambda file: file.write_text(document, encoding="utf-8"))
    _write(path.with_suffix(".txt"), lambda file: file.write_text(text, encoding="utf-8"))
    if len(report.rows):
        columns = np.ascontiguousarray(report.rows.T)
        recording = Recording(dict(zip(report.channels, columns, strict=True)))
        _write(path.with_suffix(".csv"), lambda file: write_csv(recording, file, compressed=False))
    return path


def kept_trip_report(
    report: TripReport,
    directory: Path,
    say: Say,
    path: Path | None = None,
    journal: Say = lambda sentence: None,
) -> Path | None:
    """Write a trip report (`write_trip_report`) and return the path of its JSON.

    If it cannot be written, the reason and the report are shown by `say`, the report as one text
    of several lines, so that it is one event of the live stream; the reason is passed to `journal`,
    and None is returned then.
    """
    try:
        return write_trip_report(report, directory, path)
    except Exception as error:  # the rig's parts must be ended after any error
        why = error.strerror if isinstance(error, OSError) else failure(error)
        say(f"{_UNWRITTEN}: {why}")
        say("\n".join(report.lines()))
        # Where the disk is full, the journal is too.
        with suppress(OSError):
            journal(f"{_UNWRITTEN}: {why}; its cause: {report.sentence}")
        return None


def trip_error(report: TripReport, path: Path | None) -> TripError:
    """Return the error to raise for a trip: the first-out cause in words, remedy, report's path.

    The path is None if the report was not written.
    """
    remedy = explain(report.first[1], report.concerned).remedy
    where = f" ({path})" if path is not None else ""
    return TripError(f"tripped: {report.sentence}; {remedy}{where}", path, report.first[1])


def _write(path: Path, write: Callable[[Path], object]) -> None:
    partial = path.with_name(f".{path.name}.partial")
    try:
        write(partial)
        os.replace(partial, path)
    finally:
        partial.unlink(missing_ok=True)


def _after(when_ns: int, at_ns: int) -> str:
    return f"{1e-6 * (when_ns - at_ns):+.0f} ms"


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _passed_in_segment(board: Board, limits: int) -> tuple[RungPassed, ...]:
    """Return which of so many limits were passed in the loop's present segment."""
    segment = int(board.words[Word.SEGMENT])
    found = latest_passings(board.passing_log)
    return tuple(each for each in found if each.segment == segment and each.rung < limits)


class EventLog:
    """The log of a session: who did what, what another master drove, and the trip report.

    Args:
        rig: the rig's configuration.
        directory: folder of the run, in which a trip report is written.
        say: shows a line to the operator.
        journal: is called with a sentence when another master drives a part of the rig, and when
            the trip report cannot be written.

    Attributes:
        report: the report of the trip; None before a trip was reported.
        test_limits: the limits of the present test that the loop judges beside those of the rig.
    """

    def __init__(self, rig: Rig, directory: Path, say: Say, journal: Say) -> None:
        self._rig = rig
        self._directory = directory
        self._say = say
        self._journal = journal
        self._notes: list[News] = []
        self._driven: dict[tuple[str, str], Driven] = {}
        self.test_limits: Sequence[ChannelLimit] = ()
        self.report: TripReport | None = None
        self._reported: Path | None = None

    def note(self, who: str, what: str) -> None:
        """Record for a trip report who did what at the present time."""
        self._notes.append(News(time.monotonic_ns(), who, what))

    def take(self, news: News) -> None:
        """Record a part's report, and show it to the operator.

        A report on another master (`Driven`) replaces an earlier one on the same part of the rig,
        and is passed to `journal`, too.
        """
        text = news.text
        if isinstance(news, Driven):
            self._driven[news.who, news.part] = news
            text = news.sentence
            self._journal(text)
        self._notes.append(News(news.at_ns, news.who, text))
        self._say(f"{news.who}: {text}")

    def tripped(
        self, board: Board, channels: tuple[str, ...], made_safe: Mapping[str, int]
    ) -> TripError:
        """Return the error of the trip; at the first call, make and write the trip report.

        Args:
            board: the memory that all processes share.
            channels: names of a row's columns.
            made_safe: `TripReport.made_safe`.

        The first call waits for `LAST_NEWS_S`. If the report cannot be written, its lines are shown
        to the operator, and the journal says so.
        """
        if self.report is None:
            # Slow drivers are read again now, and an error of one may be why the loop tripped.
            time.sleep(LAST_NEWS_S)
            self.report = TripReport(
                trips=trips_of(board),
                confirmations={what: int(board.words[at]) for what, at in STEPS.items()},
                notes=tuple(self._notes),
                channels=channels,
                rows=RingReader(board).latest(round(LAST_S * self._rig.loop.rate)),
                channel=loop_channel(board),
                limits=(*self._rig.ladder, *self.test_limits),
                driven=tuple(self._driven.values()),
                of_test=len(self.test_limits),
                passed=_passed_in_segment(board, len(self._rig.ladder) + len(self.test_limits)),
                made_safe=made_safe,
            )
            self._keep()
        return trip_error(self.report, self._reported)

    def complete_report(self) -> None:
        """Write the trip report again if another master did something that it does not contain.

        Without a trip report nothing is done.
        """
        report, driven = self.report, tuple(self._driven.values())
        if report is not None and report.driven != driven:
            self.report = replace(report, driven=driven, notes=tuple(self._notes))
            self._keep()

    def _keep(self) -> None:
        if self.report is not None:
            self._reported = kept_trip_report(
                self.report, self._directory, self._say, self._reported, self._journal
            )
