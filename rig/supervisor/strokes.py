"""Slow strokes of the ram with a bypass open: what a calibration measures in.

At rest an open bypass empties its chamber, or levels both, and little flows; a ram that moves
pushes its friction, some 2.5 MPa, through the bypass as long as it moves.
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
"""How long the ram takes back to where a stroke begins, its coming to rest included."""
SPEED: Final = 0.05
"""m/s. Fast enough that friction is smooth, slow beside what the valve passes."""
_MARGIN_M: Final = 0.05
"""How far strokes stay from the limits of position: room for the loop to lag and to overshoot."""
_BATCH_TICKS: Final = 250


class Samples(NamedTuple):
    """What was read during a motion, one row a tick; NaN where a sample is missing."""

    flows: Array
    """(n, 3), m^3/s, in the order of `METERS`."""
    pressures: Array
    """(n, 2), Pa."""


class Strokes:
    """Slow strokes of an armed and homed rig's ram, and its bypass valves between them.

    Every method raises `TripError` on a trip, a stop, or if the rig is not where it should be.
    """

    def __init__(self, rig: ConnectedRig) -> None:
        self._rig = rig
        limits = rig.configured.limits
        room = limits.position_max_m - limits.position_min_m - 2.0 * _MARGIN_M
        self._middle_m = 0.5 * (limits.position_min_m + limits.position_max_m)
        self._length_m = min(SPEED * STROKE_S, room)

    def shut_bypasses(self) -> None:
        """Shut every ball valve and needle."""
        self._move(preparing_moves(self._rig.configured, ()))

    def open_bypass(self, kind: str, opening: float) -> None:
        """Open the ball valve of a bypass, and its needle as far as given."""
        self._move({f"{kind}_ball": 1.0, f"{kind}_needle": opening})

    def feedback(self, kind: str) -> float:
        """Return where the needle of a bypass says it is; NaN if it does not say."""
        return self._rig.slow(f"{kind}_needle")

    def rest(self, duration_s: float) -> Samples:
        """Hold the ram in mid stroke and return what is read."""
        return self._follow(np.full(round(duration_s / TICK), self._middle_m))

    def stroke(self, direction: float) -> Samples:
        """Move the ram at constant speed, 1 out or -1 in, and return what is read meanwhile."""
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
            period_s=TICK,
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
