"""Holds a campaign while its conditions are not met, and lets it go on once they are again."""

import time
from collections.abc import Callable, Iterable, Sequence
from math import isnan
from typing import Final

from faults import Condition, WhenUnmet
from rig.recording import unit_of

Reading = Callable[[str], float | None]

MOST_SUSPENSIONS: Final = 5
"""How often a test is interrupted and run again before its campaign is stopped."""


class Suspender:
    """One condition, followed over time.

    It holds once its channel was beyond a limit, or without a reading, for the condition's time;
    it releases once the channel was back by the hysteresis for as long.
    """

    def __init__(self, condition: Condition) -> None:
        self.condition = condition
        self.holds_since: float | None = None
        self._value: float | None = None
        self._changing_since: float | None = None

    def look(self, value: float | None, now: float) -> None:
        """Take a reading at a time in s.

        The value is NaN if the channel has no reading, None if none can be had at present.
        """
        if value is None:
            return
        first, self._value = self._value is None, value
        held = self.holds_since is not None
        if first and not self._is_met(value, 0.0):
            # A precondition: nothing is begun that is not known to be met.
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
        """Why the campaign is held; empty if it is not."""
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
    """All conditions of a campaign.

    Args:
        conditions: of the campaign.
        reading: newest value of a channel.
    """

    def __init__(self, conditions: Iterable[Condition], reading: Reading) -> None:
        self._suspenders = [Suspender(condition) for condition in conditions]
        self._reading = reading

    def look(self) -> None:
        """Read every channel."""
        for suspender in self._suspenders:
            suspender.look(self._reading(suspender.condition.channel), time.monotonic())

    @property
    def reasons(self) -> Sequence[str]:
        """The reasons why the campaign is to be held; none if it may run."""
        return [each.reason for each in self._suspenders if each.reason]

    @property
    def interrupts(self) -> bool:
        """Whether a test that runs is to be ended."""
        return any(
            each.reason and each.condition.action is WhenUnmet.INTERRUPT
            for each in self._suspenders
        )

    @property
    def given_up(self) -> bool:
        """Whether a condition was not met for longer than the campaign shall wait."""
        now = time.monotonic()
        return any(
            each.holds_since is not None and now - each.holds_since > each.condition.give_up_s
            for each in self._suspenders
        )
