"""The `segments` of a sweep's motion are read here: those of a campaign, the same in all cases."""

from collections.abc import Iterator
from typing import Annotated, Any, Final

from pydantic import create_model

from control import FromFile, Sequence
from rig.configuration.campaigns import SegmentFile, Times, context_of, read_motion
from rig.configuration.reading import Located, Schema, Under, show
from rig.configuration.rigs import Rig

from .distributions import KINDS
from .motion_keys import EveryMotionFile

_ENDS_EARLY: Final = ("until", "wait_for")


_LAID_OUT: Any = {
    key: (field.annotation, field)
    for key, field in SegmentFile.model_fields.items()
    if key not in _ENDS_EARLY
}
SweptSegmentFile: Any = create_model(
    "SweptSegmentFile",
    __base__=Schema,
    __doc__="Keys of a segment of a sweep's motion: a test's, without `until` and `wait_for`.",
    **_LAID_OUT,
)


class SweptLoopFile(Schema):
    """Keys of a loop of such segments, which runs them as many times as `loop` says."""

    loop: Times
    segments: Annotated[Any, Under(lambda: (SweptSegmentFile, SweptLoopFile), many=True)]


class SweptSegmentsFile(EveryMotionFile):
    """Keys of a motion with segments, which are those of a test and the same in all its cases."""

    segments: Annotated[Any, Under(lambda: (SweptSegmentFile, SweptLoopFile), many=True)]


def read_sequence(item: Located, rig: Rig | None, seed: int, duration_s: float) -> Sequence | None:
    """Return the setpoint that the segments of a motion make; record all problems, and None if any.

    Args:
        item: the motion.
        rig: the rig whose limits the segments must keep; None if it is unusable.
        seed: seed of setpoints that are drawn at random and have no seed of their own.
        duration_s: duration of a case, s, beyond which the segments must not last.
    """
    problems = item.sources.problems
    before = problems.reported
    for mapping in _mappings(item.find("segments")):
        _check_laid_out(mapping)
    if problems.reported > before:
        return None
    context = context_of(duration_s, seed, item.place.path.parent)
    motion = read_motion(item, context, rig, SweptSegmentsFile.model_fields)
    if motion is None or not isinstance(motion.setpoint, Sequence):
        return None
    if any(isinstance(each.setpoint, FromFile) for each in motion.setpoint.stretches):
        limit = "have a setpoint from a file, which the workers of a sweep may not have"
        item.refuse(limit, "give it as another type, or run it as a campaign", "", "segments")
        return None
    if motion.duration_s > duration_s + 1e-9:
        lasts, case = show(motion.duration_s, "s"), show(duration_s, "s")
        limit = f"last {lasts}, and every case lasts {case}"
        item.refuse(limit, "let `duration` be as long, or shorten them", "", "segments")
        return None
    return motion.setpoint


def _mappings(item: Located) -> Iterator[Located]:
    """Yield a value and all values below it that are mappings."""
    if isinstance(item.value, dict):
        yield item
    for below in [*(entry for _, entry in item.items()), *item.elements()]:
        yield from _mappings(below)


def _check_laid_out(item: Located) -> None:
    """Record a problem if a mapping lets a segment differ from case to case."""
    for key in _ENDS_EARLY:
        if item.get(key) is not None:
            limit = (
                "would end the segment at another time in each case, and the setpoints of cases "
                "that run side by side are laid out before they begin"
            )
            remedy = "give the segment a duration, or run it as a campaign"
            item.refuse(limit, remedy, "", key)
    for key, entry in item.items():
        if isinstance(entry.value, dict) and set(entry.value) & set(KINDS):
            limit = "is drawn, and segments must meet without a jump in all cases, so are the same"
            remedy = "give one value, or several motions with segments, each with its `share`"
            item.refuse(limit, remedy, "", key)
