"""A calibration measures during slow strokes of the ram with a bypass open.

At rest the pressure across an open bypass falls away, and little flows. The friction of a moving
ram keeps up a pressure difference of some 2.5 MPa, which drives flow through the bypass.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io import METERS
from rig.loop import Drive, LoopStoppedError, WireLoop
from rig.plant import TICK

from .arming import bring
from .connected_rig import ConnectedRig
from .moves import preparing_moves
from .states import Event

Array = NDArray[np.float64]

STROKE_S: Final = 6.0
RETURN_S: Final = 2.5
"""Time in s in which the ram returns to where a stroke begins and comes to rest there."""
SPEED: Final = 0.05
"""Speed of a stroke in m/s: fast enough for smooth friction, slow beside what the valve can do."""
_MARGIN_M: Final = 0.05
"""Distance in m of strokes from the position limits, as the loop may lag and overshoot."""
_BATCH_TICKS: Final = 250


class Samples(NamedTuple):
    """The samples of a motion, one row per tick; NaN where a sample is missing."""

    flows: Array
    """Flows (n, 3) in m^3/s, in the order of `METERS`."""
    pressures: Array
    """Pressures (n, 2) of chambers 1 and 2 in Pa."""


class Strokes:
    """The motions for a calibration: it moves the ram of an armed and homed rig, and its bypasses.

    Every method that moves something raises `TripError` if the rig trips or is stopped, or if the
    valves do not follow.
    """

    def __init__(self, rig: ConnectedRig) -> None:
        self._rig = rig
        limits = rig.configured.limits
        room = limits.position_max_m - limits.position_min_m - 2.0 * _MARGIN_M
        self._middle_m = 0.5 * (limits.position_min_m + limits.position_max_m)
        self._length_m = min(SPEED * STROKE_S, room)

    def shut_bypasses(self) -> None:
        """Shut every ball valve and needle, and wait until they are."""
        self._move(preparing_moves(self._rig.configured, ()))

    def open_bypass(self, kind: str, opening: float) -> None:
        """Open the ball valve of a bypass and its needle to `opening`, 0 to 1; await the feedback.

        The bypass is named by the fault `kind` that it makes; the others stay as they are.
        """
        self._move({f"{kind}_ball": 1.0, f"{kind}_needle": opening})

    def feedback(self, kind: str) -> float:
        """Return the newest opening, 0 to 1, that the needle of the bypass for a fault reported.

        It is NaN if no driver reads the needle, it was not read yet, or the last read failed.
        """
        return self._rig.slow(f"{kind}_needle")

    def rest(self, duration_s: float) -> Samples:
        """Hold the ram in mid stroke for a time in s, and return the samples of that time."""
        return self._follow(np.full(round(duration_s / TICK), self._middle_m))

    def stroke(self, direction: float) -> Samples:
        """Move the ram at constant speed, out (1) or in (-1), and return the samples meanwhile.

        First the ram goes to the stroke's beginning. The stroke lasts `STROKE_S` and has its middle
        at mid stroke; it is slower than `SPEED` if the position limits leave too little room.
        """
        way = np.linspace(-0.5, 0.5, round(STROKE_S / TICK))
        return self._follow(self._middle_m + direction * self._length_m * way)

    def _move(self, outputs: dict[str, float]) -> None:
        bring(self._rig, outputs, "the bypass valves are not where they were sent", "look at them")

    def _follow(self, setpoint: Array) -> Samples:
        rig = self._rig
        segment = rig.segment(Drive.TRACK, setpoint=setpoint)
        wire = WireLoop(
            rig.board,
            rig.parts.loop,
            segment,
            start_position=float(setpoint[0]),
            settle_ticks=round(RETURN_S / TICK),
            silence_s=rig.configured.loop.loop_silence,
        )
        rows = []
        try:
            rig.check()
            rig.handle(Event.POSITION)
            wire.position()
            rig.handle(Event.POSITIONED)
            rig.handle(Event.RUN)
            while wire.ticks_left:
                rig.check()
                rows.append(wire.advance(_BATCH_TICKS))
            wire.safe_state()
            rig.handle(Event.DONE)
        except LoopStoppedError as error:
            raise rig.stopped(error) from None
        return _samples(np.concatenate(rows), wire.channels)


def _samples(rows: Array, channels: tuple[str, ...]) -> Samples:
    pressures = ("pressure_1_Pa", "pressure_2_Pa")
    return Samples(*(rows[:, [channels.index(name) for name in names]]
                     for names in (METERS, pressures)))  # fmt: skip
