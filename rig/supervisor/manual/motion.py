"""A manual motion is laid out a little ahead of the loop, with a stop at the end of what is known.

`Planner` holds how far the motion is certain. Beyond that it lays out how the ram comes to rest,
which the next turn replaces by more motion. So the ram rests soon whenever no next turn comes.
"""

from collections.abc import Callable
from math import sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK

from .bounds import ACCELERATION, Bounds
from .generator import Generator

Array = NDArray[np.float64]

_STEP_M: Final = 1e-9
"""Distance in m within which a target counts as reached."""


class Plan(NamedTuple):
    """What is laid out from a place on.

    Attributes:
        first: index of the first setpoint.
        values: (n,) setpoints in m; the last ones bring the ram to rest.
        sure: number of the first of these that the next plan leaves as they are.
    """

    first: int
    values: Array
    sure: int


class _Going:
    """A motion towards a target, until it is there or until a place.

    Args:
        target_m: position.
        speed: greatest speed, m/s.
        until: index of the setpoint from which the motion is brought to rest; None for no such.
    """

    def __init__(self, target_m: float, speed: float, until: int | None = None) -> None:
        self.target_m, self.speed, self.until = target_m, speed, until


class Planner:
    """The motion of a ram that rests at `position_m` when its segment begins.

    Args:
        position_m: setpoint with which the segment begins.
        bounds: what a setpoint may do.

    Attributes:
        place: index of the first setpoint that is not certain yet.
        position_m: setpoint before that.
        speed: speed in m/s there.
        generator: the generator that runs; None without.
    """

    def __init__(self, position_m: float, bounds: Bounds) -> None:
        self.bounds = bounds
        self.place = 0
        self.position_m, self.speed = position_m, 0.0
        self.generator: Generator | None = None
        self._going: _Going | None = None
        self._then: Callable[[], Generator] | None = None
        self._stop = ACCELERATION
        self._ahead = np.empty(0)
        self._before: dict[str, Any] = {}

    @property
    def rests(self) -> bool:
        """Whether the setpoint rests, and nothing more is asked for."""
        return self._going is None and self.generator is None and self.speed == 0.0

    def go(self, target_m: float, speed: float, until: int | None = None) -> None:
        """Move to a position at a speed; with `until`, be at rest soon after that place."""
        self._leave()
        if self.speed == 0.0:
            self._stop = ACCELERATION
        self._going = _Going(target_m, speed, until)

    def alive_until(self, until: int) -> None:
        """Let a motion that `go` began with `until` go on to another place, if it still goes on."""
        if self._going is not None and self._going.until is not None:
            self._going.until = until

    def generate(self, made: Callable[[], Generator], mean_m: float, speed: float) -> None:
        """Move to the mean of a generator, and have it begin there."""
        self.go(mean_m, speed)
        self._then = made

    def halt(self) -> None:
        """Bring the motion to rest at once."""
        self._leave()

    def caught_up(self, place: int) -> bool:
        """Go on from a later place, up to which the ram follows the stop that was laid out.

        Return whether a motion was broken off for that: a generator, which cannot go on there.
        """
        gone = min(place - self.place, len(self._ahead))
        if gone > 0:
            before = np.concatenate(([self.position_m], self._ahead[:gone]))
            self.position_m = float(before[-1])
            self.speed = float(before[-1] - before[-2]) / TICK
        self.place = max(self.place, place)
        broken = self.generator is not None
        if broken:
            self._leave()
        return broken

    def extend(self, to: int) -> Plan:
        """Make the motion certain up to a place; return it with the stop that follows."""
        self._before = dict(vars(self))
        first, ticks = self.place, max(to - self.place, 0)
        sure: list[float] = []
        while len(sure) < ticks:
            if self.generator is not None:
                sure += self._generated(ticks - len(sure))
            else:
                sure.append(self._stepped(first + len(sure)))
        self.place = first + ticks
        self._ahead = self._stopped()
        values = np.concatenate((sure, self._ahead, [self._rest()]))
        return Plan(first, values, ticks)

    def dropped(self) -> bool:
        """Forget the last `extend`, which the loop did not take; return as `caught_up` does."""
        vars(self).update(self._before)
        broken = self.generator is not None
        if broken:
            self._leave()
        return broken

    def _rest(self) -> float:
        return float(self._ahead[-1]) if self._ahead.size else self.position_m

    def _generated(self, ticks: int) -> list[float]:
        assert self.generator is not None
        self._stop = max(ACCELERATION, self.generator.acceleration)
        values = self.generator.sample(ticks)
        before = np.concatenate(([self.position_m], values))
        self.position_m, self.speed = float(before[-1]), float(before[-1] - before[-2]) / TICK
        if self.generator.at_rest:
            self._leave()
        return list(values)

    def _stepped(self, place: int) -> float:
        """Return the setpoint of the next tick of a motion to a target, or on the way to rest."""
        going = self._going
        if going is None or (going.until is not None and place >= going.until):
            self._slow(0.0)
            if self.speed == 0.0 and going is not None:
                self._leave()
            return self.position_m
        left = going.target_m - self.position_m
        step = self._stop * TICK
        # The greatest speed from which the ram still comes to rest at the target, in whole ticks.
        most = step * (sqrt(0.25 + 2.0 * abs(left) / (step * TICK)) - 0.5)
        self._slow(float(np.copysign(min(going.speed, most), left)))
        if abs(going.target_m - self.position_m) < _STEP_M + 0.5 * step * TICK:
            self.position_m, self.speed = going.target_m, 0.0
            then = self._then
            self._leave()
            if then is not None:
                self.generator = then()
        return self.position_m

    def _slow(self, wanted: float) -> None:
        """Bring the speed towards the wanted one by a tick's acceleration, and move by a tick."""
        step = self._stop * TICK
        self.speed += float(np.clip(wanted - self.speed, -step, step))
        self.position_m += self.speed * TICK
        if self.speed == 0.0 and self._going is None:
            self._stop = ACCELERATION

    def _stopped(self) -> Array:
        """Return the setpoints from the certain end of the motion until rest; none if it rests."""
        ticks = int(np.ceil(abs(self.speed) / (self._stop * TICK)))
        left = np.linspace(1.0, 0.0, ticks + 1)[1:] if ticks else np.empty(0)
        return self.position_m + self.speed * TICK * np.cumsum(left)

    def _leave(self) -> None:
        self.generator = self._going = self._then = None
