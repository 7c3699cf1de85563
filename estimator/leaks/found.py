"""The faults that were named in the course of a recording: which, from when to when, how large."""

from collections.abc import Sequence
from dataclasses import dataclass

from .confirmation import Hold
from .detection import Decision, is_of


@dataclass(frozen=True)
class Found:
    """A fault that a detector named during some part of a recording.

    Attributes:
        decision: the decision on this fault with the greatest statistic.
        detected_at_s: sample time at which the fault was first named.
        ended_s: time at which the fault ended, to half a second or so; the last time at which it
            was named where the accounts do not show the end; None while it may be present.
        confirmed: whether the fault was named for 5 s; pauses of up to 5 s do not interrupt this.
    """

    decision: Decision
    detected_at_s: float
    ended_s: float | None
    confirmed: bool

    @property
    def active(self) -> bool:
        """Return whether the fault may still be present at the end of the recording."""
        return self.ended_s is None

    @property
    def stays(self) -> bool:
        """Return whether the fault stays on record: it was confirmed, or may still be present."""
        return self.confirmed or self.active


@dataclass
class _Course:
    """What is known so far of one fault while the decisions are gone through in order."""

    strongest: Decision
    latest: Decision
    first_s: float
    last_s: float
    hold: Hold
    confirmed: bool = False


def found_in(history: Sequence[tuple[float, Decision]]) -> tuple[Found, ...]:
    """Return all faults that a detector named, in the order in which they were first named.

    `multiple` and `unknown_fault` count like faults of their own. A fault that begins again after
    its end is another one (`is_of`).

    Args:
        history: pairs of time in s and decision, as in `estimator.leaks.replaying.ReplayResult`;
            may be empty.
    """
    courses: list[_Course] = []
    for time_s, decision in history:
        if not decision.names_a_fault:
            continue
        of = next((each for each in reversed(courses) if is_of(decision, each.latest)), None)
        if of is None:
            of = _Course(decision, decision, time_s, time_s, Hold())
            courses.append(of)
        if decision.statistic > of.strongest.statistic:
            of.strongest = decision
        of.latest, of.last_s = decision, time_s
        of.confirmed |= of.hold.found(time_s)
    return tuple(_found(each, *history[-1]) for each in courses)


def _found(course: _Course, time_s: float, final: Decision) -> Found:
    ended_s = course.latest.ended_s
    if ended_s is None and course.latest is not final:
        ended_s = course.last_s
    return Found(course.strongest, course.first_s, ended_s, course.confirmed)
