"""A segment of the loop whose setpoints are laid out as a person asks for motions."""

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import PLAIN, feedforward_command, law_of
from rig.loop import LEAST_AHEAD_TICKS, Action, Drive, SetAhead, Word
from rig.plant import TICK
from rig.supervisor.connected_rig import ANSWER_S, ConnectedRig

from .bounds import Bounds
from .motion import Plan, Planner

Array = NDArray[np.float64]

SEGMENT_TICKS: Final = round(600.0 / TICK)
"""Number of setpoints of a segment, of 10 minutes. A motion that lasts longer comes to rest."""
LAST_TICKS: Final = round(4.0 / TICK)
"""Number of ticks before the end of a segment at which a motion that goes on is brought to rest."""
AHEAD_TICKS: Final = 60
"""Number of ticks that a motion is laid out ahead: three turns of the supervisor.

One of them may be late, and `LEAST_AHEAD_TICKS` are left. What a person asks for acts so much
later.
"""
FAR_AHEAD_TICKS: Final = 200
"""The same for a generator, which a late turn breaks off; nobody waits for its answer."""
_LEAD_TICKS: Final = 100
"""Number of ticks after a plan for which the feedforward is computed, as it looks ahead by the
valve's lag."""


class Live:
    """A segment in which the ram follows a planner; it begins at rest, where the loop holds it.

    Args:
        rig: an armed and homed rig, whose loop holds the ram.
        bounds: what the setpoints may do.

    Attributes:
        planner: what is asked of the ram.

    Raises:
        TripError: the rig tripped or was stopped, or the loop does not begin the segment.
    """

    def __init__(self, rig: ConnectedRig, bounds: Bounds) -> None:
        self._rig, self._words = rig, rig.board.words
        here = rig.latest("setpoint_m")
        here = here if np.isfinite(here) else rig.latest("position_m")
        here = float(np.clip(here, bounds.low_m, bounds.high_m))
        self.planner = Planner(here, bounds)
        control = rig.configured.control
        own = control.feedforward_gain is not None
        self._settings = replace(
            control, feedforward="none" if own else "model", integral_time=None, cyclic=False
        )
        par, gain = rig.model.parameters, rig.configured.gain_V_per_m
        law = law_of(self._settings, par, rig.configured.sensors, gain)
        guide = PLAIN._replace(law=law, feedforward=np.zeros(SEGMENT_TICKS))
        rig.switch_to(Drive.TRACK, setpoint=np.full(SEGMENT_TICKS, here), guide=guide)
        self._number = int(self._words[Word.SWITCH])
        rig.wait(
            lambda: self._words[Word.SEGMENT] == self._number, ANSWER_S,
            "the loop does not begin the motion", "end what else loads this computer",
        )  # fmt: skip

    @property
    def place(self) -> int:
        """The index of the setpoint that the loop follows next."""
        return int(self._words[Word.TICK])

    @property
    def ticks_left(self) -> int:
        """Number of ticks after which a motion of this segment is brought to rest."""
        return SEGMENT_TICKS - LAST_TICKS - self.place

    @property
    def stopped(self) -> bool:
        """Whether the loop has ended the motion by itself, for a limit."""
        return bool(self._words[Word.ACTION] >= Action.HOLD)

    def turn(self) -> bool:
        """Lay the motion out further; return whether a generator was broken off.

        That is so if this process or the loop's came too late. The ram then comes to rest by what
        was laid out before; a motion to a target goes on from there.

        Raises:
            ChildError: the loop's process is gone or does not answer.
        """
        planner, here, broken = self.planner, self.place, False
        if planner.rests:
            return False
        ahead = AHEAD_TICKS if planner.generator is None else FAR_AHEAD_TICKS
        if planner.place < here + LEAST_AHEAD_TICKS:
            broken = planner.caught_up(here + AHEAD_TICKS)
            # Otherwise a supervisor whose turns are all as late would never get on.
            ahead += AHEAD_TICKS
        position, speed = planner.position_m, planner.speed
        plan = planner.extend(here + ahead)
        if plan.first + plan.values.size > SEGMENT_TICKS:
            return broken
        order = SetAhead(
            self._number, plan.first, plan.values, self._feedforward(plan, position, speed),
            planner.rests,
        )  # fmt: skip
        if not self._rig.ask(self._rig.parts.loop, order, ANSWER_S):
            broken = planner.dropped() or broken
        return broken

    def _feedforward(self, plan: Plan, position_m: float, speed: float) -> Array:
        """Return the feedforward in V of a plan; position and speed are those before it."""
        before = [position_m - speed * TICK, position_m]
        whole = np.concatenate((before, plan.values, np.full(_LEAD_TICKS, plan.values[-1])))
        limit = self._rig.configured.limits.command_V
        volts = feedforward_command(whole, self._settings, self._rig.model.parameters, limit)
        return volts[2 : 2 + plan.values.size]
