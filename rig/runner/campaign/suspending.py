"""Decides when a campaign is held because its conditions are not met, and when it goes on."""

import time
from collections.abc import Callable, Iterable, Sequence
from math import isnan
from typing import Final

from faults import Condition, WhenUnmet
from rig.recording import unit_of

Reading = Callable[[str], float | None]

MOST_SUSPENSIONS: Final = 5
"""Number of interruptions of one test by conditions at which its campaign is stopped."""


class Suspender:
    """Follows one condition over time, and decides whether it holds the campaign.

    A condition holds the campaign after its channel was beyond a limit, or had no reading, at every
    look for `condition.for_s`; it releases the campaign after the channel was within the limits by
    at least the hysteresis for the same time. If the very first reading is NaN or beyond a limit,
    the condition holds the campaign at once.

    Attributes:
        condition: the condition.
        holds_since: time since when the condition holds the campaign, s of the monotonic clock;
            None while it does not.
    """

    def __init__(self, condition: Condition) -> None:
        self.condition = condition
        self.holds_since: float | None = None
        self._value: float | None = None
        self._changing_since: float | None = None

    def look(self, value: float | None, now: float) -> None:
        """Process a reading of the condition's channel.

        Args:
            value: the reading; NaN if the channel has none, which is beyond the limits; None if
                there is no rig to be read, as between two simulated tests: the condition then
                holds nothing until the next rig is read.
            now: time of the reading, s of the monotonic clock.
        """
        if value is None:
            self.holds_since = self._changing_since = None
            return
        first, self._value = self._value is None, value
        held = self.holds_since is not None
        if first and not self._is_met(value, 0.0):
            # At the start it is a precondition: no test begins before the condition is met.
            self.holds_since = now
            return
        if self._is_met(value, self.condition.hysteresis if held else 0.0) is not held:
            self._changing_since = None
            return
        if self._changing_since is None:
            self._changing_since = now
        if now - self._changing_since >= self.condition.for_s:
            self.holds_since = None if held else now
            self._changing_since = None

    def _is_met(self, value: float, inside: float) -> bool:
        return self.condition.low + inside <= value <= self.condition.high - inside

    @property
    def reason(self) -> str:
        """Why this condition holds the campaign; empty if it does not."""
        if self.holds_since is None or self._value is None:
            return ""
        condition, value = self.condition, self._value
        if isnan(value):
            return f"{condition.channel} has no reading"
        unit = unit_of(condition.channel)
        upper = value > condition.high - condition.hysteresis
        limit = condition.high if upper else condition.low
        word = "above" if upper else "below"
        back = limit - condition.hysteresis if upper else limit + condition.hysteresis
        return (
            f"{condition.channel} is {value:.6g} {unit}, {word} {limit:.6g} {unit}; "
            f"goes on at {back:.6g} {unit}"
        )


class Suspenders:
    """All conditions of a campaign, followed together: whether they hold it, why, and for too long.

    Args:
        conditions: the campaign's conditions.
        reading: returns the newest value of a channel: NaN if it has none, and None if there is no
            rig to read, as `Bench.reading` does.
    """

    def __init__(self, conditions: Iterable[Condition], reading: Reading) -> None:
        self._suspenders = [Suspender(condition) for condition in conditions]
        self._reading = reading

    def look(self) -> None:
        """Read the channel of every condition, and update which conditions hold the campaign."""
        for suspender in self._suspenders:
            suspender.look(self._reading(suspender.condition.channel), time.monotonic())

    @property
    def reasons(self) -> Sequence[str]:
        """Why the campaign is held, a sentence for each condition that holds it; empty if none."""
        return [each.reason for each in self._suspenders if each.reason]

    @property
    def interrupts(self) -> bool:
        """Whether a condition that holds the campaign asks to end the running test, too."""
        return any(
            each.reason and each.condition.action is WhenUnmet.INTERRUPT
            for each in self._suspenders
        )

    @property
    def given_up(self) -> bool:
        """Whether a condition has held the campaign for longer than its `give_up_s`."""
        now = time.monotonic()
        return any(
            each.holds_since is not None and now - each.holds_since > each.condition.give_up_s
            for each in self._suspenders
        )
