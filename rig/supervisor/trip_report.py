"""A trip report holds the first-out cause, the steps of the trip, and the rig's last seconds."""

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.configuration import show
from rig.io import ChannelLimit
from rig.loop import Action, Cause, TripError, explain
from rig.recording import Recording, unit_of, write_csv
from rig.supervisor.processes import Driven

Array = NDArray[np.float64]

SCHEMA: Final = "rig-trip"
STAGES: Final = ("wakeup_s", "sent_s", "exchange_s", "compute_s", "age_s")
"""Columns of a row with timings whose statistics a report gives; see `rig.loop.wire.layout`."""
_UNCONFIRMED: Final = {
    "valve null": Cause.NULL_NOT_CONFIRMED,
    "bypass shut": Cause.BYPASS_NOT_SHUT,
    "pump unloaded": Cause.PUMP_NOT_UNLOADED,
}


@dataclass(frozen=True)
class Note:
    """A note in the report: who did or asked for what, and when (CLOCK_MONOTONIC in ns)."""

    at_ns: int
    who: str
    what: str


@dataclass(frozen=True)
class Confirmation:
    """The confirmation of one step of a trip.

    Attributes:
        what: the step: "valve null", "bypass shut" or "pump unloaded".
        at_ns: when the device confirmed it, CLOCK_MONOTONIC in ns; 0 or less if it never did.
    """

    what: str
    at_ns: int


@dataclass(frozen=True)
class TripReport:
    """A report with all that is known of one trip.

    Attributes:
        trips: part that tripped -> (cause, time), CLOCK_MONOTONIC in ns; at least one.
        confirmations: the steps of the trip, in their order.
        notes: who did or asked for what, in order of time.
        channels: names of the rows' columns, `time_s` first.
        rows: float64 (n, columns), the last rows of the loop; may be empty.
        channel: the channel that the loop's cause concerns, one of `FAST_INPUTS`; empty if none.
        limits: the limits of the rig's channels.
        driven: reports on parts that another master drove out of their safe state.
    """

    trips: Mapping[str, tuple[Cause, int]]
    confirmations: Sequence[Confirmation]
    notes: Sequence[Note]
    channels: tuple[str, ...]
    rows: Array
    channel: str = ""
    limits: Sequence[ChannelLimit] = ()
    driven: Sequence[Driven] = ()

    @property
    def first(self) -> tuple[str, Cause, int]:
        """The first-out cause: who tripped first, the cause, the time (CLOCK_MONOTONIC, ns)."""
        who = min(self.trips, key=lambda name: self.trips[name][1])
        return who, *self.trips[who]

    @property
    def concerned(self) -> str:
        """The channel that the first-out cause concerns; empty if it concerns none."""
        return self.channel if self.first[0] == "loop" else ""

    @property
    def value(self) -> float:
        """The last value, not NaN, of the `concerned` channel up to the loop's trip, SI.

        It is NaN if the cause concerns no channel, or the rows hold no value of it.
        """
        if self.concerned not in self.channels or not len(self.rows):
            return float("nan")
        values = self.rows[:, self.channels.index(self.concerned)]
        end = len(values)
        if "action" in self.channels:
            tripped = self.rows[:, self.channels.index("action")] >= Action.TRIP
            end = int(np.argmax(tripped)) + 1 if tripped.any() else end
        known = values[:end][np.isfinite(values[:end])]
        return float(known[-1]) if known.size else float("nan")

    @property
    def limit(self) -> float:
        """The trip limit that the `concerned` channel exceeded, SI; NaN if the cause is no limit.

        If the channel has several trip limits, it is the tightest one.
        """
        bounds = {Cause.LIMIT_LOW: max, Cause.LIMIT_HIGH: min}
        cause = self.first[1]
        if cause not in bounds:
            return float("nan")
        low = cause is Cause.LIMIT_LOW
        rungs = [
            rung for rung in self.limits if (rung.channel, rung.action) == (self.concerned, "trip")
        ]
        ends = [rung.low if low else rung.high for rung in rungs]
        return bounds[cause](ends) if ends else float("nan")

    @property
    def sentence(self) -> str:
        """The first-out cause in words, with the channel's value and limit as far as known."""
        text = explain(self.first[1], self.concerned).sentence
        unit = unit_of(self.concerned)
        if not unit or not np.isfinite(self.value):
            return text
        text += f": {show(self.value, unit)}"
        return text + (f", limit {show(self.limit, unit)}" if np.isfinite(self.limit) else "")

    @property
    def summary(self) -> str:
        """The first-out cause in words, with its remedy."""
        return f"tripped: {self.sentence}; {explain(self.first[1], self.concerned).remedy}"

    def stages(self) -> dict[str, dict[str, float]]:
        """Return name in `STAGES` -> median (p50), 99th percentile (p99) and maximum (max), in s.

        Timings that the rows do not hold, or hold only as NaN, are left out.
        """
        found: dict[str, dict[str, float]] = {}
        for name in STAGES:
            if name not in self.channels:
                continue
            values = self.rows[:, self.channels.index(name)]
            values = values[np.isfinite(values)]
            if values.size:
                p50, p99 = np.percentile(values, [50.0, 99.0])
                found[name] = {"p50": float(p50), "p99": float(p99), "max": float(values.max())}
        return found

    def lines(self) -> list[str]:
        """Return the report as lines for the terminal, the first-out cause first."""
        who, cause, at_ns = self.first
        lines = [f"tripped by the {who}: {self.sentence}", f"  remedy: {explain(cause).remedy}"]
        for step in self.confirmations:
            if step.at_ns > 0:
                lines.append(f"  {step.what} confirmed {_after(step.at_ns, at_ns)}")
            else:
                unconfirmed = _UNCONFIRMED.get(step.what)
                remedy = explain(unconfirmed).remedy if unconfirmed else "look at the rig"
                lines.append(f"  {step.what} NOT CONFIRMED: {remedy}")
        for found in self.driven:
            first, last = _after(found.first_ns, at_ns), _after(found.last_ns, at_ns)
            span = f"{first} to {last}" if found.times > 1 else first
            lines.append(f"  {found.sentence}, {span}; it was brought back to its safe state")
        for other, (reason, when) in sorted(self.trips.items(), key=lambda item: item[1][1]):
            if other != who:
                lines.append(
                    f"  then the {other} {_after(when, at_ns)}: {explain(reason).sentence}"
                )
        for name, stage in self.stages().items():
            figures = ", ".join(f"{key} {1e6 * value:.0f} us" for key, value in stage.items())
            lines.append(f"  {name.removesuffix('_s')}: {figures}")
        lines += [f"  {_after(note.at_ns, at_ns)} {note.who}: {note.what}" for note in self.notes]
        return lines

    def document(self) -> dict[str, Any]:
        """Return the report as JSON values, without its rows.

        Times are in s after the first trip; None for a time that is not known, and for a value that
        is not finite. Only `time`, that of the first trip, is a date and time (UTC, ISO 8601).
        """
        who, cause, at_ns = self.first

        def after_s(when: int) -> float | None:
            return 1e-9 * (when - at_ns) if when > 0 else None

        return {
            "schema": SCHEMA,
            "time": _wall_time(at_ns),
            "by": who,
            "cause": cause.name,
            "sentence": self.sentence,
            "remedy": explain(cause).remedy,
            "channel": self.concerned or None,
            "value": _finite(self.value),
            "limit": _finite(self.limit),
            "trips": [
                {"by": name, "cause": reason.name, "after_s": after_s(when)}
                for name, (reason, when) in sorted(self.trips.items(), key=lambda item: item[1][1])
            ],
            "confirmations": [
                {"what": step.what, "after_s": after_s(step.at_ns)} for step in self.confirmations
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
            "stages_s": self.stages(),
            "notes": [
                {"after_s": after_s(note.at_ns), "who": note.who, "what": note.what}
                for note in self.notes
            ],
        }


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
    if path is None:
        number = 1
        while (directory / f"trip-{number}.json").exists():
            number += 1
        path = directory / f"trip-{number}.json"
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
    report: TripReport, directory: Path, say: Callable[[str], None], path: Path | None = None
) -> Path | None:
    """Write a trip report and return its path; if it cannot be written, show it and return None."""
    try:
        return write_trip_report(report, directory, path)
    except OSError as error:
        say(f"the trip report cannot be written: {error.strerror}")
        for line in report.lines():
            say(line)
        return None


def trip_error(report: TripReport, path: Path | None) -> TripError:
    """Return the error that a trip raises: the report's summary, and the report's path, if any."""
    return TripError(report.summary + (f" ({path})" if path is not None else ""), path)


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


def _wall_time(at_ns: int) -> str:
    seconds = 1e-9 * (time.time_ns() - time.monotonic_ns() + at_ns)
    return datetime.fromtimestamp(seconds, UTC).isoformat(timespec="milliseconds")
