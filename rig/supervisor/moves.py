"""The faults of a test are turned here into moves of the valves that make them."""

from collections.abc import Iterable, Mapping
from math import inf
from typing import Final

import numpy as np

from faults import BypassValve, Fault, Verdict, linked
from rig.channels import BLOCKING
from rig.configuration import Rig
from rig.plant import TICK

Move = tuple[int, Mapping[str, float]]

RAMP_STEP_S: Final = 0.1
"""Time in s between the steps by which a needle follows a ramp.

Slow I/O and the needle's drive cannot follow shorter ones.
"""


def preparing_moves(rig: Rig, faults: Iterable[Fault]) -> dict[str, float]:
    """Return slow output -> value before a test, for all valves by which the rig makes faults.

    All balls are shut (0). Each needle has the opening, 0 to 1, with which the earliest fault of
    its bypass begins, so that the leak begins with the turn of the ball, and not with the slow
    motion of the needle. A needle without a fault is at 0. So is the throttle in the return line,
    whether it has a fault or not; it is open there. Blocking valves are open (0), too.
    """
    outputs = dict.fromkeys(BLOCKING, 0.0) if rig.blocking_valves is not None else {}
    for kind in rig.injectable:
        outputs[f"{kind}_needle"] = 0.0
        if kind != Verdict.RETURN_BLOCKAGE:
            outputs[f"{kind}_ball"] = 0.0
    for fault in sorted(faults, key=lambda fault: fault.at_s, reverse=True):
        if fault.kind != Verdict.RETURN_BLOCKAGE:
            outputs[f"{fault.kind}_needle"] = _opening(rig, fault, 0.0)
    return outputs


def moves(rig: Rig, faults: Iterable[Fault]) -> tuple[Move, ...]:
    """Return the moves that make the faults of a test: (tick, output -> value), sorted by tick.

    Ticks count from the start of the test. Before the first move, the valves must be where
    `preparing_moves` puts them.

    Args:
        rig: a rig whose valves can make the faults, as `check` has verified.
        faults: the faults of one test.
    """
    made: list[Move] = []
    previous_end: dict[str, float] = {}
    for fault in linked(faults):
        made += _moves_of(rig, fault, previous_end.get(fault.kind))
        previous_end[fault.kind] = fault.end_s
    return tuple(sorted(made, key=lambda move: move[0]))


def _moves_of(rig: Rig, fault: Fault, previous_end_s: float | None) -> list[Move]:
    needle, ball = f"{fault.kind}_needle", f"{fault.kind}_ball"
    made: list[Move] = []
    blocks = fault.kind == Verdict.RETURN_BLOCKAGE
    follows = fault.follows > 0.0
    if not blocks and not follows:
        if previous_end_s is not None:
            made.append((_tick(previous_end_s), {needle: _opening(rig, fault, 0.0)}))
        made.append((_tick(fault.at_s), {ball: 1.0}))
    if blocks or follows or fault.ramp_s > 0.0:
        steps = max(round(fault.ramp_s / RAMP_STEP_S), 1) if fault.ramp_s > 0.0 else 0
        elapsed = np.linspace(0.0, fault.ramp_s, steps + 1)
        made += [
            (_tick(fault.at_s + since_s), {needle: _opening(rig, fault, float(since_s))})
            for since_s in elapsed
            if fault.at_s + since_s < fault.until_s
        ]
    if fault.until_s < inf and not fault.goes_on:
        made.append((_tick(fault.until_s), {needle: 0.0} if blocks else {ball: 0.0}))
    return made


def _opening(rig: Rig, fault: Fault, since_s: float) -> float:
    """Return the value of a fault's needle, `since_s` seconds after the fault began.

    For a leak it is the needle's opening, 0 to 1; for a blocked return line it is how far its
    throttle is shut, from 0 (open) to 1.
    """
    share = 1.0 if fault.ramp_s == 0.0 else min(since_s / fault.ramp_s, 1.0)
    coefficient = fault.follows + (fault.coefficient - fault.follows) * share
    if fault.kind == Verdict.RETURN_BLOCKAGE:
        assert rig.return_valve is not None
        return min(coefficient / rig.return_valve.maximum, 1.0)
    valve: BypassValve = rig.bypass_valves[fault.kind]
    return valve.needle_opening_for(max(coefficient, valve.minimum))


def _tick(time_s: float) -> int:
    return round(time_s / TICK)
