"""The emulated bypass valves: balls and needles that need time to move, and their watchdog.

The blocking valves of a rig that has them are driven by the same device, and are here too.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rig.channels import BLOCKING, BYPASSES
from rig.emulator.record import Record
from rig.io import THROTTLE

_SHUT, _OPEN = 0.0, 1.0
_NEEDLE_TRAVEL_S: Final = 2.0
"""Time in s that a needle takes over its whole range."""


@dataclass
class _Drive:
    """Moves a valve towards its target at a constant speed."""

    travel_s: float
    position: float = _SHUT
    target: float = _SHUT
    stuck: bool = False

    def advance(self, elapsed_s: float) -> float | None:
        """Move for `elapsed_s`; return how much of this time is left on arrival at the target.

        Return None if the valve does not arrive: it is on its way, stuck, or there already.
        """
        distance = self.target - self.position
        if self.stuck or distance == 0.0:
            return None
        left_s = elapsed_s - abs(distance) * self.travel_s
        if left_s >= 0.0:
            self.position = self.target
            return left_s
        step = elapsed_s / self.travel_s
        self.position += step if distance > 0.0 else -step
        return None


class ValveBank:
    """The valves of all bypasses, a ball and a needle each; the throttle's ball is always open.

    Args:
        record: takes note of orders, arrivals and the watchdog.
        clock: returns the time in ns.
        ball_travel_s: time that a ball takes from shut to open, s.
        blocking_travel_s: time that a blocking valve takes from open to shut, s; None for a rig
            without them.

    Attributes:
        watchdog_ms: time in ms without a request after which the balls are shut, and throttle and
            blocking valves are opened; 0: never.
    """

    def __init__(
        self,
        record: Record,
        clock: Callable[[], int],
        ball_travel_s: float = 0.5,
        blocking_travel_s: float | None = None,
    ) -> None:
        self.watchdog_ms = 0
        self._record = record
        self._clock = clock
        self._valves = {
            bypass: (
                None if bypass == THROTTLE else _Drive(ball_travel_s),
                _Drive(_NEEDLE_TRAVEL_S),
            )
            for bypass in BYPASSES
        }
        # The position of a blocking valve is the share by which it is shut.
        travel_s = blocking_travel_s
        self._blocking = {v: _Drive(travel_s) for v in BLOCKING} if travel_s is not None else {}
        self._time_ns = self._heard_ns = clock()
        self._barked = False

    def hear(self) -> None:
        """Restart the watchdog's time, since the host has sent a request."""
        self.tend()
        self._heard_ns = self._time_ns
        self._barked = False

    def tend(self) -> None:
        """Advance the valves to the present; a watchdog whose time is over acts as of its end."""
        now = self._clock()
        deadline = self._heard_ns + self.watchdog_ms * 1_000_000
        if self.watchdog_ms and not self._barked and deadline <= now:
            self._advance(deadline)
            self._bark(deadline)
        self._advance(now)

    def watch(self, watchdog_ms: int) -> None:
        """Set the time in ms without a request after which the watchdog acts; 0: never."""
        self.tend()
        self._record.note("bypass_watchdog_set", self._time_ns, watchdog_ms=watchdog_ms)
        self.watchdog_ms = watchdog_ms

    def order_ball(self, bypass: str, opened: bool) -> None:
        """Start to open or shut the ball of a bypass; the return throttle has none."""
        self.tend()
        self._record.note("ball_ordered", self._time_ns, bypass=bypass, opened=opened)
        ball, _ = self._valves[bypass]
        assert ball is not None
        ball.target = _OPEN if opened else _SHUT

    def order_needle(self, bypass: str, opening: float) -> None:
        """Start to move a needle to an opening, 0 to 1."""
        self.tend()
        self._record.note("needle_ordered", self._time_ns, bypass=bypass, opening=opening)
        self._valves[bypass][1].target = opening

    def order_blocking(self, valve: str, shut: bool) -> None:
        """Start to shut or open a blocking valve, one of `rig.channels.BLOCKING`."""
        self.tend()
        self._record.note("blocking_ordered", self._time_ns, valve=valve, shut=shut)
        self._blocking[valve].target = float(shut)

    def blocking(self) -> dict[str, float]:
        """Return by which share, 0 to 1, each blocking valve is shut now; {} without them."""
        self.tend()
        return {valve: drive.position for valve, drive in self._blocking.items()}

    def blocking_orders(self) -> dict[str, bool]:
        """Return whether each blocking valve is ordered to be shut; {} for a rig without them."""
        self.tend()
        return {valve: drive.target == 1.0 for valve, drive in self._blocking.items()}

    def stick(self, bypass: str, stuck: bool = True) -> None:
        """Jam both valves of a bypass where they are, or free them to go on to their targets.

        A blocking valve can be jammed likewise, by its name.
        """
        self.tend()
        if bypass in self._blocking:
            self._blocking[bypass].stuck = stuck
            return
        for drive in filter(None, self._valves[bypass]):
            drive.stuck = stuck

    def positions(self) -> dict[str, tuple[float, float]]:
        """Return the positions (ball, needle) of each bypass now, from 0 (shut) to 1 (open)."""
        self.tend()
        return {
            bypass: (ball.position if ball else _OPEN, needle.position)
            for bypass, (ball, needle) in self._valves.items()
        }

    def orders(self) -> dict[str, tuple[bool, float]]:
        """Return the targets of each bypass: whether the ball is to be open, and the needle's.

        The return throttle, which has no ball, has False for it.
        """
        self.tend()
        return {
            bypass: (ball is not None and ball.target == _OPEN, needle.target)
            for bypass, (ball, needle) in self._valves.items()
        }

    def _advance(self, until_ns: int) -> None:
        elapsed_s = 1e-9 * (until_ns - self._time_ns)
        self._time_ns = until_ns
        for bypass, (ball, needle) in self._valves.items():
            needle.advance(elapsed_s)
            left_s = ball.advance(elapsed_s) if ball else None
            if ball and left_s is not None:
                at_ns = until_ns - round(1e9 * left_s)
                opened = ball.position == _OPEN
                self._record.note("ball_arrived", at_ns, bypass=bypass, opened=opened)

        for valve, drive in self._blocking.items():
            left_s = drive.advance(elapsed_s)
            if left_s is not None:
                at_ns = until_ns - round(1e9 * left_s)
                shut = drive.position == 1.0
                self._record.note("blocking_arrived", at_ns, valve=valve, shut=shut)

    def _bark(self, at_ns: int) -> None:
        self._barked = True
        self._record.note("bypass_watchdog_trip", at_ns, watchdog_ms=self.watchdog_ms)
        for ball, _ in self._valves.values():
            if ball:
                ball.target = _SHUT
        self._valves[THROTTLE][1].target = _SHUT
        for drive in self._blocking.values():
            drive.target = 0.0


SWITCHES: Final = {_OPEN: (True, False), _SHUT: (False, True)}
"""The states of a ball's switches "open" and "shut" at either end of its travel. Between the ends
both are off."""
