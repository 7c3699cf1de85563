"""The faults that were named in the course of a recording: which, from when to when, how large."""

from collections.abc import Sequence
from dataclasses import dataclass

from .confirmation import Hold
from .decision import Decision, is_of


@dataclass(frozen=True)
class Found:
    """A fault that a detector named during some part of a recording.

    Attributes:
        decision: the decision on this fault with the greatest statistic; if it came and went, the
            latest that says so.
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


def found_in(history: Sequence[tuple[float, Decision]]) -> tuple[Found, ...]:
    """Return all faults that a detector named, in the order in which they were first named.

    `multiple` and `unknown_fault` count like faults of their own. A fault that begins again after
    its end is another one (`is_of`).

    Args:
        history: pairs of time in s and decision, as in `estimator.leaks.replaying.ReplayResult`;
            may be empty.
    """
    courses: list[list[tuple[float, Decision]]] = []
    for time_s, decision in history:
        if not decision.names_a_fault:
            continue
        of = next((each for each in reversed(courses) if is_of(decision, each[-1][1])), None)
        if of is None:
            of = []
            courses.append(of)
        of.append((time_s, decision))
    return tuple(_found(course, history[-1][1]) for course in courses)


def _found(course: Sequence[tuple[float, Decision]], final: Decision) -> Found:
    """Return the record of one fault from the decisions that name it, with their times in s.

    `final` is the last decision on the recording; a fault that it does not name has ended.
    """
    hold = Hold()
    confirmed = [hold.found(time_s) for time_s, _ in course]
    last_s, latest = course[-1]
    ended_s = latest.ended_s
    if ended_s is None and latest is not final:
        ended_s = last_s
    returning = [decision for _, decision in course if decision.returns is not None]
    strongest = max((decision for _, decision in course), key=lambda each: each.statistic)
    if returning:
        strongest = returning[-1]
    return Found(strongest, course[0][0], ended_s, any(confirmed))
