"""The motion of a test is read here: one setpoint, or several segments one after the other."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from pydantic import Field as SchemaField

from control import Constant, Sequence, Setpoint, SetpointError, Stretch, period_of
from faults import SegmentEnd, Until
from rig.configuration.reading import (
    Located,
    Name,
    Physical,
    Schema,
    Under,
    elements_of,
    read_mapping,
    refuse_missing,
    show,
)
from rig.configuration.rigs import Rig
from rig.plant import TICK

from .awaited import read_segment_until, segment_until_files
from .setpoints import DURATION, SetpointContext, read_setpoint, setpoint_files

Cycles = Annotated[int | None, SchemaField(ge=1, le=1_000_000)]
Times = Annotated[int, SchemaField(ge=1, le=1000)]
_MOST_SEGMENTS: Final = 1000
_DEFAULT_S: Final = 60.0
"""Duration by which a setpoint is read whose own is wrong, so that its keys are checked."""


_HINTS: Final = {
    "leak_test": "the ram is locked in it: write a test of its own, - {name: ..., leak_test: {}}"
}


class SegmentFile(Schema):
    """Keys of a segment: a setpoint with duration, cycles or `until`; or `hold` or `wait_for`."""

    name: Name | None = None
    setpoint: Annotated[Any, Under(setpoint_files)] = None
    duration: Annotated[float | None, Physical("s", 1e-3, 3600.0, 10.0)] = None
    cycles: Cycles = None
    hold: Annotated[float | None, Physical("s", 1e-3, 3600.0, 10.0)] = None
    blend: Annotated[float, Physical("s", 0.0, 600.0, 2.0)] = 0.0
    until: Annotated[Any, Under(segment_until_files)] = None
    wait_for: Annotated[Any, Under(segment_until_files)] = None


class SegmentLoopFile(Schema):
    """Keys of a loop of segments, which runs its segments as many times as `loop` says."""

    loop: Times
    segments: Annotated[Any, Under(lambda: (SegmentFile, SegmentLoopFile), many=True)]


class Motion(NamedTuple):
    """The setpoint of a test, how long the test lasts at most, s, and what ends its segments."""

    setpoint: Setpoint
    duration_s: float
    ends: tuple[SegmentEnd, ...] = ()


def read_motion(
    item: Located, context: SetpointContext, rig: Rig | None, known: Iterable[str]
) -> Motion | None:
    """Return the motion of a test; record all problems, and return None if it cannot be made.

    A test has a `setpoint` with a `duration` or `cycles`, or it has `segments`. A setpoint that
    goes beyond the rig's limits is a problem.

    Args:
        item: the test.
        context: duration, seed and folder for its setpoint; the duration is the test's if the test
            gives one.
        rig: the rig whose limits are checked; None if it is unusable.
        known: keys that a test may have.
    """
    problems = item.sources.problems
    before = problems.reported
    if item.get("segments") is not None:
        motion = _segmented(item, context, rig)
    else:
        motion = _single(item, context, rig, known)
    return motion if problems.reported == before else None


def _single(
    item: Located, context: SetpointContext, rig: Rig | None, known: Iterable[str]
) -> Motion | None:
    given = item.get("setpoint")
    timed = item.get("duration") is not None or item.get("cycles") is not None
    # An `until` that could be read has given a duration; what is wrong with another is reported.
    if not timed and item.get("until") is None:
        refuse_missing(item, "duration", known)
    if given is None:
        refuse_missing(item, "setpoint", known)
        return None
    setpoint = read_setpoint(given, context)
    if setpoint is None:
        return None
    duration_s = _duration(item, setpoint, context.duration_s)
    if duration_s is None:
        return None
    entry = item.get("cycles")
    if entry is not None and not DURATION.lower <= duration_s <= DURATION.upper:
        stretch = f"{DURATION.lower:g} s to {DURATION.upper:g} s"
        limit = f"last {duration_s:g} s, and a test lasts {stretch}"
        entry.refuse(limit, "ask for another number of cycles, or for repeats of the test")
        return None
    if rig is not None:
        check_against_limits(setpoint, duration_s, given, rig)
    return Motion(setpoint, duration_s) if timed else None


def _duration(item: Located, setpoint: Setpoint, duration_s: float) -> float | None:
    """Return how long a setpoint lasts by the keys `duration` and `cycles` beside it, s.

    It is a whole number of ticks. If the keys contradict each other, or the setpoint has no cycles,
    record a problem and return None.
    """
    entry = item.get("cycles")
    if entry is None:
        return duration_s
    if item.get("duration") is not None:
        limit = "is given with a duration, which it takes the place of"
        entry.refuse(limit, "give one of both")
        return None
    if not isinstance(entry.value, int):
        return None
    period_s = period_of(setpoint)
    if period_s is None:
        kind = type(setpoint).__name__.lower()
        limit = f"has no meaning for a setpoint of type {kind}, which does not repeat itself"
        entry.refuse(limit, "give a duration; sine, triangle, trapezoid and multisine have cycles")
        return None
    return round(entry.value * period_s / TICK) * TICK


@dataclass
class _Reader:
    """A reader of the segments of one test, which follow one another.

    Attributes:
        stretches: the usable segments so far, with the place of each in the file.
        broken: whether a segment could not be read, so that where the next one begins is unknown.
        untils: index of a stretch -> what ends it early.
    """

    context: SetpointContext
    rig: Rig | None
    start: float | None
    stretches: list[tuple[Stretch, Located]] = field(default_factory=list)
    broken: bool = False
    untils: dict[int, Until] = field(default_factory=dict)

    def read(self, items: list[Located]) -> None:
        for item in items:
            if item.get("loop") is not None or item.get("segments") is not None:
                self._read_loop(item)
            else:
                self._read_segment(item)

    def _read_loop(self, item: Located) -> None:
        file = read_mapping(SegmentLoopFile, item)
        if file is None:
            self.broken = True
            return
        inner = elements_of(item.get("segments"), "write a list of segments: - {setpoint: ...}")
        problems = item.sources.problems
        for _ in range(file.loop):
            before = problems.reported
            self.read(inner)
            if problems.reported > before or len(self.stretches) > _MOST_SEGMENTS:
                break
        if len(self.stretches) > _MOST_SEGMENTS:
            item.refuse(f"makes more than {_MOST_SEGMENTS} segments", "loop less often", key="loop")
            self.broken = True

    def _read_segment(self, item: Located) -> None:
        problems = item.sources.problems
        before = problems.reported
        file = read_mapping(SegmentFile, item, _HINTS)
        stretch = None
        until = self._until(item)
        if file is not None and problems.reported == before:
            lasts_s = None if until is None else until[1]
            rests = file.hold is not None or item.get("wait_for") is not None
            stretch = (self._hold if rests else self._moving)(item, file, lasts_s)
        if stretch is None or not self._is_joined(item, stretch):
            self.broken = True
            return
        if until is not None:
            self.untils[len(self.stretches)] = until[0]
        self.stretches.append((stretch, item))

    def _until(self, item: Located) -> tuple[Until, float] | None:
        """Return what ends a segment, and after how long it ends at the latest, s; None if nothing.

        Record a problem if another key says when it ends.
        """
        given = [key for key in ("wait_for", "until") if item.get(key) is not None]
        if not given:
            return None
        others = ("hold", "duration", "cycles", "until", "setpoint", "blend")
        for key in others if given[0] == "wait_for" else others[:3]:
            if item.get(key) is not None:
                limit = f"is given with {given[0]}, which says by itself how the segment goes"
                remedy = "leave one of both out: `at_most` says how long it lasts at the latest"
                item.refuse(limit, remedy, key=key)
                return None
        return read_segment_until(item.find(given[0]), self.rig)

    def _is_joined(self, item: Located, stretch: Stretch) -> bool:
        """Return whether a segment can begin wherever the one before ends; if not, record why."""
        index = len(self.stretches) - 1
        if index not in self.untils or isinstance(self.stretches[index][0].setpoint, Constant):
            return True
        if stretch.blend_s > 0.0:
            return True
        limit = "follows a moving segment with until, which may end anywhere"
        item.refuse(limit, "give it a setpoint and `blend: 2 s`, which brings the ram there", "")
        return False

    def ends(self, sequence: Sequence) -> tuple[SegmentEnd, ...]:
        """Return what ends segments early, with the times at which they are laid out."""
        found = []
        for index, until in self.untils.items():
            stretch, start = sequence.stretches[index], sequence.starts_s[index]
            later = sequence.stretches[index + 1 : index + 2]
            name = stretch.name or f"segment {index + 1}"
            begin, end = start + stretch.blend_s, start + stretch.total_s
            found.append(SegmentEnd(until, name, begin, end, later[0].blend_s if later else 0.0))
        return tuple(found)

    def _hold(self, item: Located, file: SegmentFile, most_s: float | None) -> Stretch | None:
        for key in ("setpoint", "duration", "cycles", "blend"):
            if item.get(key) is not None:
                limit = "is given with hold, which says all about a segment that rests"
                item.refuse(limit, "leave one of both out", key=key)
                return None
        lasts_s = file.hold if most_s is None else most_s
        if self.broken or lasts_s is None:
            return None
        if not self.stretches:
            if self.start is None:
                remedy = "give the test a start_position, or begin with a setpoint"
                item.refuse("has nothing to hold at the begin of a test", remedy, key="hold")
                return None
            return Stretch(Constant(self.start), lasts_s, file.name or "")
        before, _ = self.stretches[-1]
        if before.setpoint.quantity != "position":
            remedy = "write a constant setpoint of 0 V"
            item.refuse("holds a position, and this test has no position loop", remedy, key="hold")
            return None
        end = float(before.setpoint.sample(np.array([before.duration_s]))[0])
        return Stretch(Constant(end), lasts_s, file.name or "")

    def _moving(self, item: Located, file: SegmentFile, most_s: float | None) -> Stretch | None:
        given = item.get("setpoint")
        if given is None:
            item.refuse("has no motion", "give it a setpoint, `hold: 10 s`, or wait_for", "")
            return None
        if file.duration is None and file.cycles is None and most_s is None:
            if item.get("until") is None:
                remedy = "give it a duration, or cycles of its setpoint, or until"
                item.refuse("has no end", remedy, "")
            return None
        duration_s = file.duration or most_s or _DEFAULT_S
        setpoint = read_setpoint(given, self.context._replace(duration_s=duration_s))
        lasts_s = None if setpoint is None else _duration(item, setpoint, duration_s)
        if setpoint is None or lasts_s is None:
            return None
        lasts_s = max(round(lasts_s / TICK), 1) * TICK
        blend_s = round(file.blend / TICK) * TICK
        if blend_s and not self.stretches and not self.broken:
            remedy = "leave it out: the ram is at the start position when the test begins"
            item.refuse("has no segment before it", remedy, key="blend")
            return None
        if self.rig is not None:
            check_against_limits(setpoint, lasts_s, given, self.rig)
        return Stretch(setpoint, lasts_s, file.name or "", blend_s)


def _segmented(item: Located, context: SetpointContext, rig: Rig | None) -> Motion | None:
    entry = item.find("segments")
    for key in ("setpoint", "duration", "cycles"):
        if item.get(key) is not None:
            limit = "is given with segments, each of which has its own"
            item.refuse(limit, "leave one of both out", key=key)
    start = item.get("start_position")
    reader = _Reader(context, rig, _position(start))
    elements = elements_of(entry, "write a list: - {setpoint: ..., duration: ...}")
    if not elements and isinstance(entry.value, list):
        entry.refuse("is empty", "give at least one segment")
    reader.read(elements)
    if reader.broken or not reader.stretches:
        return None
    try:
        sequence = Sequence(tuple(stretch for stretch, _ in reader.stretches))
    except SetpointError as error:
        for problem in error.problems:
            index = int(problem.field.partition("[")[2].removesuffix("]"))
            place = reader.stretches[index][1]
            place.refuse(problem.limit, problem.remedy, problem.value, name="segment")
        return None
    if not DURATION.lower <= sequence.duration_s <= DURATION.upper:
        limit = f"is not within {DURATION.lower:g} s to {DURATION.upper:g} s, as a test lasts"
        entry.refuse(limit, "change the segments, or split the test", f"{sequence.duration_s:g} s")
        return None
    return Motion(sequence, sequence.duration_s, reader.ends(sequence))


def _position(item: Located | None) -> float | None:
    if item is None:
        return None
    try:
        return Physical("m").parse(item.value)
    except ValueError:
        return None


def check_against_limits(setpoint: Setpoint, duration_s: float, item: Located, rig: Rig) -> None:
    """Record a problem if a setpoint goes beyond the limits of the rig within its duration."""
    limits = rig.limits.of(setpoint.quantity)
    times = np.arange(round(duration_s / TICK)) * TICK
    values = setpoint.sample(times)
    worst = int(np.argmax(np.maximum(values - limits.upper, limits.lower - values)))
    value = float(values[worst])
    if limits.lower <= value <= limits.upper:
        return
    above = value > limits.upper
    end = show(limits.upper if above else limits.lower, limits.unit)
    limit = f"is {'above' if above else 'below'} the {end} of the rig {rig.name}"
    is_position = setpoint.quantity == "position"
    remedy = "reduce or shift the motion" if is_position else "reduce the command"
    item.refuse(limit, remedy, f"{show(value, limits.unit)} at {times[worst]:.3f} s")


def context_of(duration_s: float | None, seed: int, folder: Path) -> SetpointContext:
    """Return the context of a test's setpoint, with another duration if the test's is not known."""
    return SetpointContext(duration_s or _DEFAULT_S, seed, folder)
