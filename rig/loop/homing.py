"""Homing finds the zero of an incremental encoder at an end stop, gently.

The ram approaches the stop twice, in open loop. The first approach finds the stop; the second one,
which is slower, must find it at the same count. If `Homing` is late or lost, two things limit what
the ram can do: the compiled loop keeps a ram that is not homed below a command and a load pressure
(`rig.loop.interlocks.judging.allowed_command`), and each move ends by itself.
"""

from collections import deque
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import Final

from rig.io import HomingSettings
from rig.plant import Parameters

BACK_OFF: Final = 0.02
"""Way in m back from the stop between the approaches, so that the second is a separate motion."""
SLOWER: Final = 0.6
"""Command of the second approach in that of the first; a null bias of 10 um must not stop it."""
REPEATABLE_COUNTS: Final = 5
"""Greatest difference in counts between the stops that the two approaches find; the stop itself
gives way by two counts at the force of contact."""
_CONTACT: Final = 0.5
"""Part of the load-pressure limit with which the ram must push to count as being at a stop."""
_OVERTRAVEL: Final = 1.05
"""Travel, in strokes, beyond which no stop can follow, so that the encoder's scale is wrong."""


class HomingError(Exception):
    """Raised when homing finds no certain stroke end; the message gives reason and remedy."""


class Phase(Enum):
    """The phases of a homing run, in order."""

    APPROACH = "approach"
    BACK_OFF = "back off"
    SECOND_APPROACH = "second approach"
    DONE = "done"


_PARTS: Final = {
    Phase.APPROACH: 1.0,
    Phase.BACK_OFF: -1.0,
    Phase.SECOND_APPROACH: SLOWER,
    Phase.DONE: 0.0,
}
"""Command of each phase towards the stop, in that of the first approach."""


@dataclass(frozen=True)
class HomingSample:
    """The measured values that homing needs, at least ten times a second.

    Attributes:
        time_s: time since any fixed moment.
        position_m: position as the encoder counts it, from where it was switched on.
        pressure_1_Pa: pressure of chamber 1, which extends the ram.
        pressure_2_Pa: pressure of chamber 2.
    """

    time_s: float
    position_m: float
    pressure_1_Pa: float  # noqa: N815
    pressure_2_Pa: float  # noqa: N815


class Homing:
    """One homing run, which takes samples and returns commands; it moves nothing itself.

    Args:
        settings: the end stop, the limits of command and pressure, and the times.
        par: parameters of the plant, for its stroke.
        count_m: resolution of the encoder, m.

    Attributes:
        phase: the present phase.
        offset_m: offset in m that must be added to the encoder's position; None until homing is
            done.
        apart_m: distance in m between the stops that the two approaches found; 0 until both are
            found.
    """

    def __init__(self, settings: HomingSettings, par: Parameters, count_m: float) -> None:
        self.phase = Phase.APPROACH
        self.offset_m: float | None = None
        self.apart_m = 0.0
        self._settings = settings
        self._count_m = count_m
        self._outward = 1.0 if settings.end == "extend" else -1.0
        self._stop_m = par.stroke_max if settings.end == "extend" else par.stroke_min
        self._travel_m = _OVERTRAVEL * (par.stroke_max - par.stroke_min)
        self._recent: deque[HomingSample] = deque()
        self._began: HomingSample | None = None
        self._first_m = 0.0

    @property
    def command_V(self) -> float:  # noqa: N802
        """The valve command of the present phase in V; it changes only with the phase."""
        return self._outward * (_PARTS[self.phase] * self._settings.command)

    def next_command(self, sample: HomingSample) -> float:
        """Take one sample and return the command in V from now on; 0 when homing is done.

        It enters the next phase when the present one is over, and sets `offset_m` with the last.

        Raises:
            HomingError: the ram moved the wrong way or too far, took too long for a phase, stood
                still without pushing, or the two stops were too far apart; the rig is not homed.
        """
        if self.phase is Phase.DONE:
            return 0.0
        if self._began is None:
            self._began = sample
        recent, since = self._recent, sample.time_s - self._settings.standstill
        recent.append(sample)
        while len(recent) > 1 and recent[1].time_s <= since:
            recent.popleft()
        self._check_way(sample, self._began)
        if self.phase is Phase.BACK_OFF:
            if self._way(sample, self._began) <= -BACK_OFF:
                self._enter(Phase.SECOND_APPROACH)
        elif self._stands():
            self._check_contact()
            self._at_stop(sample)
        return self.command_V

    def _enter(self, phase: Phase) -> None:
        self.phase, self._began = phase, None
        self._recent.clear()

    def _way(self, sample: HomingSample, began: HomingSample) -> float:
        """Return the way in m from the sample `began` to `sample`, positive towards the stop."""
        return self._outward * (sample.position_m - began.position_m)

    def _stands(self) -> bool:
        """Return whether the ram counts as standing still.

        It does if, within the settings' time of standstill, it has moved by one count at most, or
        no further than it would at the settings' speed.
        """
        duration = self._recent[-1].time_s - self._recent[0].time_s
        if duration < self._settings.standstill:
            return False
        positions = [sample.position_m for sample in self._recent]
        moved = max(positions) - min(positions)
        return moved <= max(self._settings.speed * duration, self._count_m)

    def _at_stop(self, sample: HomingSample) -> None:
        if self.phase is Phase.APPROACH:
            self._first_m = sample.position_m
            self._enter(Phase.BACK_OFF)
            return
        self.apart_m = abs(sample.position_m - self._first_m)
        counts = self.apart_m / self._count_m
        # Half a count is allowed, since positions are whole counts only up to rounding.
        if counts > REPEATABLE_COUNTS + 0.5:
            raise HomingError(
                f"the stroke end was found {counts:.0f} counts apart, {REPEATABLE_COUNTS} allowed: "
                "the encoder loses counts, or it is no firm stop; check both"
            )
        self.offset_m = self._stop_m - sample.position_m
        self._enter(Phase.DONE)

    def _check_way(self, sample: HomingSample, began: HomingSample) -> None:
        way = self._way(sample, began)
        wrong = way > BACK_OFF if self.phase is Phase.BACK_OFF else way < -BACK_OFF
        if wrong:
            raise HomingError(
                f"the ram moves the wrong way ({self.phase.value}): the encoder's direction is "
                "reversed, or the valve's null is off by more than the homing command; check both"
            )
        if abs(way) > self._travel_m:
            raise HomingError(
                f"no stop within {self._travel_m:.3g} m of travel: check the encoder's scale and "
                "the stroke in the rig file"
            )
        if sample.time_s - began.time_s > self._settings.timeout:
            raise HomingError(
                f"no end of the {self.phase.value} within {self._settings.timeout:g} s: "
                "check supply and valve; raise homing command or timeout"
            )

    def _check_contact(self) -> None:
        # The median is taken because at a stop the pressure in the stiff oil may swing a little.
        pushed = self._outward * median(
            sample.pressure_1_Pa - sample.pressure_2_Pa for sample in self._recent
        )
        least = _CONTACT * self._settings.load_pressure
        if pushed < least:
            raise HomingError(
                f"the ram stands, but pushes with {1e-6 * pushed:.2f} MPa only, "
                f"{1e-6 * least:.2f} MPa make contact: check the supply pressure, the encoder "
                "(frozen?), the pressure lines and the valve's null; raise homing command"
            )
