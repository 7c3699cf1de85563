"""Brings a digital servovalve to a target state by single transitions, each one confirmed."""

from collections.abc import Callable
from typing import Final

from .ds408 import D, DriveState, keeping_word, next_state, words_towards

Refuse = Callable[[str, str], Exception]
"""Makes an error from two texts: what is wrong, and what to do about it."""

_LOOK: Final = "look at the valve's enable input, its supply and its error memory"


class DriveWalk:
    """The way of one valve through its states to a target state.

    A walk begins with `ask`, and ends with `give_up` or `disable`. A valve that met a fault, or
    left its target by itself, is not brought back to the target until `ask` is called again.

    Args:
        timeout: longest time in s that one transition may take.
        refuse: makes the errors that are raised.

    Attributes:
        word: the control word that the driver must send; None before the first `ask` or `disable`.
    """

    def __init__(self, timeout: float, refuse: Refuse) -> None:
        self.word: int | None = None
        self._timeout = timeout
        self._refuse = refuse
        self._target: DriveState | None = None
        self._expected: DriveState | None = None
        self._words: list[int] = []
        self._until = 0.0

    @property
    def active(self) -> bool:
        """Whether the valve has confirmed the target ACTIVE, so that setpoints may be sent."""
        return self._target is DriveState.ACTIVE and self._expected is None

    def ask(self, state: DriveState, target: DriveState, now: float) -> None:
        """Begin to walk from `state` to `target` at time `now` in s; a fault is reset on the way.

        Raises:
            Exception: made by `refuse`, if the valve reacts to a fault that it met just now.
        """
        if state is DriveState.FAULT_REACTION:
            raise self._refuse(f"is in {state.name}", "wait until it has ended")
        self._target = target
        self._go_on(state, now)

    def advance(self, state: DriveState, now: float) -> None:
        """Take the next step if `state`, which the valve reports, confirms the last one.

        Without a target, nothing is done. The caller must call `give_up` when this raises.

        Raises:
            Exception: made by `refuse`, if a step took too long, or the valve left its target by
                itself.
        """
        target, expected = self._target, self._expected
        if target is None:
            return
        if expected is None:
            if state is not target:
                raise self._refuse(f"left {target.name} for {state.name} by itself", _LOOK)
        elif state is expected:
            self._go_on(state, now)
        elif now >= self._until:
            text = f"stands in {state.name}, {expected.name} wanted on the way to {target.name}"
            raise self._refuse(f"{text}, for {self._timeout:g} s", _LOOK)
        elif self._words:
            self.word = self._words.pop(0)

    def give_up(self, state: DriveState) -> None:
        """End the walk, and keep the valve in `state` until another target is asked for.

        Before the first `ask` or `disable`, nothing is commanded.
        """
        self._target = self._expected = None
        if self.word is not None:
            self.word = keeping_word(state)

    def disable(self) -> None:
        """End the walk, and command DISABLED from now on."""
        self._target = self._expected = None
        self.word = D

    def _go_on(self, state: DriveState, now: float) -> None:
        """Begin the next transition, or keep the valve in `state` if that is the target."""
        assert self._target is not None
        if state is self._target:
            self._expected, self.word = None, keeping_word(state)
            return
        self._expected = next_state(state, self._target)
        self.word, *self._words = words_towards(state, self._target)
        self._until = now + self._timeout
