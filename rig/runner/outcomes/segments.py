"""When the segments of a test took place."""

from dataclasses import dataclass

from control import Sequence
from faults import CampaignTest
from rig.plant import TICK

from .timeline import Timeline


@dataclass(frozen=True)
class SegmentRun:
    """One segment of a test, as it was run.

    Attributes:
        name: its name; empty if it has none.
        motion: the kind of its setpoint, such as "sine".
        begin_s, end_s: begin, after any blend that leads to it, and end, s of the test.
        ended_early: whether it ended before its longest duration, because what it awaited came or
            because the test ended.
    """

    name: str
    motion: str
    begin_s: float
    end_s: float
    ended_early: bool


def segments_run(
    test: CampaignTest, timeline: Timeline, recorded_s: float
) -> tuple[SegmentRun, ...]:
    """Return the segments of a test that were begun, in their order; none if it has no segments.

    Args:
        test: the test.
        timeline: when its motion took place.
        recorded_s: how long the test lasted.
    """
    if not isinstance(test.setpoint, Sequence):
        return ()
    found = []
    for start, each in zip(test.setpoint.starts_s, test.setpoint.stretches, strict=True):
        begin_s = timeline.test_s(start + each.blend_s)
        end_s = min(timeline.test_s(start + each.total_s), recorded_s)
        if end_s - begin_s < TICK:
            continue
        early = end_s - begin_s < each.duration_s - 0.5 * TICK
        kind = type(each.setpoint).__name__.lower()
        found.append(SegmentRun(each.name, kind, begin_s, end_s, early))
    return tuple(found)
