"""Moves a rig of which nobody knows yet which way its valve, encoder and pressures count.

Nothing here closes a loop of which the signs are not known: with a wrong one the ram would run away
from its setpoint, up to its stroke end. Commands are given in open loop, small and short, and the
ram is watched for how far it goes and how hard it pushes.
"""

import time
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.loop import Action, Cause, Drive, RingReader, TripError, Word, explain
from rig.plant import TICK
from rig.supervisor.processes import loop_channel

from .arming import arm, bring
from .checks import unproven_checks_for
from .connected_rig import ANSWER_S, POLL_S, ConnectedRig
from .states import Event

Array = NDArray[np.float64]

PROBED: Final = (
    "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m",
)  # fmt: skip
"""Columns of the rows that `UnprovenRig.play` returns, in their order."""
TRAVEL_M: Final = 0.06
"""Travel in m from where commands begin at which they are broken off: twice as much as the ram goes
in the longest of them (1 s) with the largest null bias that a run allows (0.47 V, 30 mm/s)."""
PUSH: Final = 0.75
"""Part of the homing section's load pressure at which commands are broken off; while a ram is homed
the loop pushes no harder. More than the supply pressure it cannot be."""
RISEN_PA: Final = 5e5
"""Rise of the load pressure in Pa since commands began without which they are not broken off: oil
that an earlier command left under pressure is relieved by this one. Noise makes a tenth of it."""


def pushes_too_hard(load_pressure: Array, limit: float) -> bool:
    """Return whether a ram pushes too hard, so that its commands are broken off.

    It does if the mean load pressure of the last 20 ms is beyond the limit, and greater than at the
    begin.

    Args:
        load_pressure: (ticks,), Pa, since the commands began; NaN where a sample is missing.
        limit: greatest load pressure of either sign, Pa.
    """
    known = load_pressure[np.isfinite(load_pressure)]
    if known.size < _MEAN_TICKS:
        return False
    first, last = (abs(float(part.mean())) for part in (known[:5], known[-_MEAN_TICKS:]))
    return last > max(limit, first + RISEN_PA)


_MEAN_TICKS: Final = 20


class BrokenOffError(Exception):
    """Raised when commands are broken off, as the ram went too far or pushed too hard."""


class WatchedRig(ConnectedRig):
    """A connected rig whose latest rows can be looked at; see `ConnectedRig` for its arguments."""

    @property
    def rows(self) -> int:
        """Number of rows that the loop has written in this session."""
        return int(self.board.words[Word.ROWS])

    def recent(self, seconds: float, channels: Sequence[str]) -> Array:
        """Return columns of the rows of the last seconds, at most 30 s, (rows, channels), SI.

        A value is NaN where no sample came.
        """
        columns = [self._channels.index(name) for name in channels]
        return RingReader(self.board).latest(round(seconds / TICK))[:, columns]


class UnprovenRig(WatchedRig):
    """A connected rig whose signs are not known; see `ConnectedRig` for its arguments."""

    _checks = staticmethod(unproven_checks_for)

    def arm(self) -> None:
        """Arm the rig with the command at 0 V; see `rig.supervisor.arming.arm`."""
        arm(self, held=False)

    def set_valves(self, wanted: dict[str, float]) -> None:
        """Move bypass valves, and wait for their feedback.

        Raises:
            TripError: the valves do not follow, or the rig tripped or was stopped.
        """
        bring(self, wanted, "the bypass valves are not where they were sent", "look at them")

    def hold(self, gain: float) -> None:
        """Hold the ram where it is with a gain in V/m of either sign; 0 means a command of 0 V."""
        self.switch_to(Drive.HOLD, gain=gain, limit=self._gentle_V)

    @property
    def _gentle_V(self) -> float:  # noqa: N802
        homing = self.configured.homing
        assert homing is not None
        return homing.command

    def play(self, commands: Sequence[float] | Array, gain: float) -> Array:
        """Give the valve one command a tick, V; return the rows, (ticks, len(PROBED)).

        Values are in SI; NaN where a sample is missing. Afterwards the ram is held as by `hold`.

        Args:
            commands: (ticks,), V.
            gain: gain of the hold afterwards.

        Raises:
            BrokenOffError: the ram went further than `TRAVEL_M` or pushed too hard.
            TripError: a limit of the rig was passed, or the rig tripped or was stopped.
        """
        wanted = np.ascontiguousarray(commands, np.float64)
        limit = max(self._gentle_V, float(np.abs(wanted).max()))
        self.handle(Event.HOME)
        reader = RingReader(self.board)
        self.switch_to(Drive.TRACK, open_loop=True, setpoint=wanted, gain=gain, limit=limit)
        number = int(self.board.words[Word.SWITCH])
        try:
            return self._watched(reader, number, wanted.size)
        finally:
            if not self.safety.tripped:
                self.hold(gain)
                self.handle(Event.HOLD)

    def _watched(self, reader: RingReader, number: int, ticks: int) -> Array:
        columns = [self._channels.index(name) for name in PROBED]
        segment = self._channels.index("segment")
        homing = self.configured.homing
        assert homing is not None
        until = time.monotonic() + ticks * TICK + ANSWER_S
        rows, start = np.empty((0, len(PROBED))), np.nan
        while len(rows) < ticks:
            self.check()
            self._heed_limits()
            if time.monotonic() > until:
                raise TripError("the loop does not give the commands; look at the session's log")
            taken = reader.take()
            rows = np.concatenate([rows, taken[taken[:, segment] == number][:, columns]])
            position = rows[np.isfinite(rows[:, 1]), 1]
            if position.size:
                start = position[0]
                travel = abs(position[-1] - start)
                if travel > TRAVEL_M:
                    raise BrokenOffError(f"the ram went {1e3 * travel:.0f} mm")
                if pushes_too_hard(rows[:, 2] - rows[:, 3], PUSH * homing.load_pressure):
                    raise BrokenOffError("the ram pushes against something")
            time.sleep(POLL_S)
        return rows

    def _heed_limits(self) -> None:
        words = self.board.words
        if Action(int(words[Word.ACTION])) >= Action.HOLD:
            sentence, remedy = explain(
                Cause(int(words[Word.ACTION_CAUSE])), loop_channel(self.board)
            )
            raise TripError(f"{sentence}; {remedy}")
