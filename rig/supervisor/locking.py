"""Locks the cylinder of a connected rig by its blocking valves, for a leak test.

The commands are laid out ahead of the loop, a moment at a time, and end at 0 V: if this process is
late, or gone, the servovalve goes to null by itself. What is safe does not hang on it either: the
loop trips if the ram moves or a chamber's pressure rises, and the field process opens the blocking
valves after any trip, once the servovalve is at null.
"""

import time
from collections.abc import Callable
from typing import Final

import numpy as np

from control import PLAIN
from rig.channels import BLOCKING, READINGS
from rig.configuration import LEAK_TEST_HZ
from rig.io import ChannelLimit
from rig.loop import (
    LEAST_AHEAD_TICKS,
    NULL_V,
    Action,
    Cause,
    Drive,
    RingReader,
    SetAhead,
    TripError,
    Word,
    explain,
    wire_channels,
)
from rig.plant import TICK, Reading
from rig.supervisor.processes import loop_channel

from .calibration import Strokes
from .connected_rig import ANSWER_S, ConnectedRig
from .states import Event

MOST_COMMAND_V: Final = 0.5
"""Greatest command in V of either sign, which the loop allows while the cylinder may be locked.
Were a blocking valve to let go, the ram would move with some 40 mm/s, as slowly as when homing."""
WAY_M: Final = 10e-3
"""Way in m from where the ram was locked at which the loop trips. The oil of a locked chamber gives
way by 2 mm: 0.2 L by 0.6 %, which is 8 MPa, over 6.3 cm^2 of piston. As one chamber is filled after
the other, the ram makes 3 mm in a whole test, and twice that if this computer is so busy that
commands come late. A ram whose valve lets go is there within a quarter of a second."""
PERIOD_TICKS: Final = round(1.0 / (LEAK_TEST_HZ * TICK))
"""Ticks from one command to the next."""
AHEAD_TICKS: Final = (LEAST_AHEAD_TICKS + 15, 60, 120)
"""Ticks from the loop's place to the first that a command changes. They are few, since the pressure
control waits for them; a command that comes too late, as on a busy computer, is sent once more each
time further ahead."""
KEPT_TICKS: Final = 250
"""Ticks for which a command stands without another, as later ones may fail to come in time. Within
them a ram that nothing holds makes `WAY_M` at 40 mm/s."""
SEGMENT_TICKS: Final = round(180.0 / TICK)
"""Ticks of the segment: five times as long as a leak test takes. Then the loop holds the ram."""
REST_S: Final = 0.5
"""Time in s for which the ram rests at mid stroke before it is locked."""
RISEN_FOR_S: Final = 0.05
"""Time in s for which a chamber's pressure must be above the supply's before that trips: longer
than a glitch, far shorter than heat, which raises it by 0.5 MPa with each kelvin."""

_COLUMNS: Final = ("time_s", "segment", "command_V", *READINGS)


class LockedRig:
    """The cylinder of an armed and homed rig, which is locked and unlocked.

    The ram is brought to mid stroke first, where both chambers are of one size. Then the loop gives
    the commands of `exchange`, of at most `MOST_COMMAND_V`, and trips if the ram leaves its place
    by `WAY_M` or a chamber's pressure rises above the supply's, as it may by heat.

    Args:
        rig: a rig with blocking valves, which is armed and homed; its session makes it safe.
        rest_s: how long the ram rests at mid stroke before it is locked, s.

    Raises:
        TripError: the rig tripped or was stopped, or does not follow.
    """

    def __init__(self, rig: ConnectedRig, rest_s: float = REST_S) -> None:
        self._rig, self._words = rig, rig.board.words
        self._look: Callable[[], None] = self._check
        self._shut = dict.fromkeys(BLOCKING, 0.0)
        names = wire_channels(rig.segment(Drive.NULL).memory.filter.states, open_loop=False)
        self._columns = [names.index(name) for name in _COLUMNS]
        strokes = Strokes(rig)
        # A bypass that a test before has opened would pass for a leak.
        strokes.shut_bypasses()
        strokes.rest(max(rest_s, REST_S))
        here = rig.latest("position_m")
        highest = rig.model.parameters.supply_pressure
        limits = [ChannelLimit("position_m", here - WAY_M, here + WAY_M)]
        for channel in ("pressure_1_Pa", "pressure_2_Pa"):
            limits.append(ChannelLimit(channel, high=highest, for_s=RISEN_FOR_S))
        rig.handle(Event.RUN)
        # Both are replaced ahead of the loop, so that they must not be one and the same array.
        guide = PLAIN._replace(feedforward=np.zeros(SEGMENT_TICKS))
        rig.event_log.test_limits = tuple(limits)
        self._reader = RingReader(rig.board)
        rig.switch_to(
            Drive.TRACK, open_loop=True, setpoint=np.zeros(SEGMENT_TICKS), guide=guide,
            limit=min(MOST_COMMAND_V, rig.configured.limits.command_V), limits=tuple(limits),
            locked=True,
        )  # fmt: skip
        self._number = int(self._words[Word.SWITCH])
        rig.wait(
            lambda: self._words[Word.SEGMENT] == self._number, ANSWER_S,
            "the loop does not begin to follow", "end what else loads this computer",
        )  # fmt: skip
        self._due = self._time_s = 0.0

    @property
    def time_s(self) -> float:
        """Time of the last sample, s, by the loop's ticks since it follows."""
        return self._time_s

    @property
    def arrived(self) -> bool:
        """Whether both blocking valves are known to be where they were sent."""
        return not self._rig.off(self._shut)

    def exchange(self, command_V: float) -> Reading:  # noqa: N803
        """Set the command, wait for a period, and return the newest sample.

        Raises:
            TripError: the rig tripped or was stopped, the loop has ended the motion by itself, or
                no sample comes.
        """
        sample = self._exchanged(command_V)
        return Reading(*sample[3:])

    def _exchanged(self, command_V: float) -> tuple[float, ...]:  # noqa: N803
        """Do as `exchange` and return the sample in the order of `_COLUMNS`."""
        kept = np.append(np.full(KEPT_TICKS, command_V), 0.0)
        for ahead in AHEAD_TICKS:
            first = int(self._words[Word.TICK]) + ahead
            order = SetAhead(self._number, first, kept, np.zeros(kept.size), False)
            # If none is taken, the command before stands for its time, and then null.
            if self._rig.ask(self._rig.parts.loop, order, ANSWER_S):
                break
        self._due = max(self._due + PERIOD_TICKS * TICK, self._time_s + 0.5 * PERIOD_TICKS * TICK)
        until = time.monotonic() + ANSWER_S
        while True:
            self._look()
            rows = self._reader.take()[:, self._columns]
            rows = rows[(rows[:, 1] == self._number) & np.isfinite(rows[:, 3:6].sum(axis=1))]
            if len(rows):
                self._time_s = float(rows[-1, 0])
                if self._time_s >= self._due:
                    return tuple(rows[-1].tolist())
            if time.monotonic() > until:
                raise TripError("no sample comes from the loop; look at the session's log")
            time.sleep(2e-3)

    def block(self, chamber_1: bool, chamber_2: bool) -> None:
        """Order the blocking valves to shut (true) or to open.

        The servovalve goes to null before, unless a chamber is locked already and stays so: the ram
        cannot move then, and the pressure of the other chamber may be regulated while its valve
        shuts.

        Raises:
            TripError: as of `exchange`.
        """
        wanted = dict(zip(BLOCKING, (float(chamber_1), float(chamber_2)), strict=True))
        opens = any(self._shut[valve] > wanted[valve] for valve in BLOCKING)
        if opens or not any(self._shut.values()):
            self._go_to_null()
        self._shut = wanted
        self._rig.write(wanted)

    def release(self) -> None:
        """Bring the servovalve to null, then open both valves, and let the loop hold the ram.

        After a trip nothing is done here: the loop has nulled the servovalve, and the field process
        opens the valves.

        Raises:
            TripError: the rig trips meanwhile, or a valve does not open.
        """
        rig = self._rig
        if rig.safety.tripped:
            return
        # Somebody who asked for the end is not asked again, as the way to it leads through here.
        self._look = rig.going_on
        self._go_to_null()
        self._shut = dict.fromkeys(BLOCKING, 0.0)
        rig.write(self._shut)
        until = time.monotonic() + ANSWER_S
        while not self.arrived:
            self._exchanged(0.0)
            if time.monotonic() > until:
                raise TripError("the blocking valves do not open; look at them")
        rig.switch_to(Drive.HOLD)
        rig.handle(Event.DONE)

    def _go_to_null(self) -> None:
        """Order 0 V and wait until it stands.

        Raises:
            TripError: it does not come.
        """
        until = time.monotonic() + ANSWER_S
        while abs(self._exchanged(0.0)[2]) > NULL_V:
            if time.monotonic() > until:
                raise TripError("the servovalve does not go to null; look at the session's log")

    def _check(self) -> None:
        """Raise `TripError` if the rig tripped, is to stop, or the loop has ended the motion."""
        self._rig.check()
        if self._words[Word.ACTION] >= Action.HOLD:
            cause = Cause(int(self._words[Word.ACTION_CAUSE]))
            sentence, remedy = explain(cause, loop_channel(self._rig.board))
            raise TripError(f"{sentence}; {remedy}")
