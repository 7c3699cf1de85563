"""Opens a rig's devices by the processes of a session, however long these compile before."""

from collections.abc import Callable
from typing import Any, Final

from rig.configuration import Rig
from rig.loop import Segment, Tolerances, limit_table, orders
from rig.supervisor.processes import Child, Onlooker, OpenField, Parts

OPEN_S: Final = 300.0
"""Time in s within which a part must open its devices, without the time in which it compiles."""
LOOK_S: Final = 0.2
"""Period in s at which, while a part opens its devices, its end and a stop are looked for."""


def opened(
    rig: Rig,
    parts: Parts,
    first: Segment,
    checks: Callable[[frozenset[str], float], Tolerances],
    look: Callable[[], None],
    onlooker: Onlooker,
) -> orders.Opened:
    """Open the slow devices, then the fast one; return the loop's answer.

    Args:
        rig: the rig.
        parts: the processes, which have opened nothing yet.
        first: the segment that the loop begins with.
        checks: returns the tolerances of the channels that must have values, and a period in s.
        look: is called every 0.2 s; an error that it raises ends the opening.
        onlooker: learns what a part compiles.

    Raises:
        DriverError: a device does not answer, or is not the configured one.
        ChildError: a part ended, or opened nothing within `OPEN_S`.
    """

    def asked(part: Child, order: object) -> Any:
        known = ""

        def look_and_tell() -> None:
            nonlocal known
            look()
            if part.compiles != known:
                known = part.compiles
                onlooker.compiles(known)

        try:
            return part.ask_patiently(order, OPEN_S, LOOK_S, look_and_tell)
        finally:
            if known:
                onlooker.compiles("")

    slow = tuple(spec for spec in rig.drivers if spec.kind == "slow")
    asked(parts.field, OpenField(slow, rig.loop, rig.calibrations))
    (fast,) = (spec for spec in rig.drivers if spec.kind == "fast")
    period_s = 1.0 / rig.loop.rate
    tolerances = checks(frozenset(fast.inputs), period_s)
    limits = limit_table(rig.ladder, period_s)
    order = orders.Open(fast, rig.loop, limits, tolerances, first, rig.calibrations, rig.wiring)
    answer: orders.Opened = asked(parts.loop, order)
    return answer
