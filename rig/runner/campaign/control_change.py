"""The control of the running test: what operators may ask for, and what waits for the loop."""

from dataclasses import dataclass, replace
from math import inf
from typing import Final

from control import ControlSettings, Margins
from faults import CampaignTest
from rig.configuration import (
    ConfigError,
    Expected,
    Rig,
    control_for,
    control_in_words,
    expected_error,
    is_mistaken,
    margins_by_model,
    margins_in_words,
    ordered_control,
    remedy_of_margins,
)
from rig.plant import Model

from .operator_requests import RefusedError

_CAMPAIGN: Final = "campaign"
"""Name in place of an operator's for a change that stands in the campaign's file."""
_INSTANT_S: Final = 1e-6
"""Time in s by which a change may be later than the tick at which it is due, by rounding."""
_FORESEEN_S: Final = 20.0
"""Time in s of the test for which the error under an order is foreseen: enough for a loop to settle
and for two periods of 0.1 Hz, and little enough that an answer takes less than about a second."""


@dataclass(frozen=True)
class ControlChange:
    """A change of the running test's control, asked for by an operator or by the campaign's file.

    Attributes:
        who: name of the operator; `campaign` for a change of the file.
        before: the settings before, in which the gain is given.
        after: the settings that are asked for, in which the gain is given.
    """

    who: str
    before: ControlSettings
    after: ControlSettings

    def __str__(self) -> str:
        """Return the keys that change, each with both values."""
        return control_in_words(self.after, self.before)


class RunningControl:
    """The control of one test while it runs, and the changes that wait to be given to the loop.

    Args:
        rig: the rig.
        test: the test.
        assumed: the model that filter and loop assume.

    Attributes:
        settings: the control settings with all changes that were asked for; the gain is given.
    """

    def __init__(self, rig: Rig, test: CampaignTest, assumed: Model) -> None:
        self._rig = rig
        self._test = test
        self._assumed = assumed
        self._waiting: list[ControlChange] = []
        self._coming = list(test.control_changes)
        self.settings = control_for(rig, test)
        self._first_gain = self.settings.gain
        self._now_s = 0.0

    def asked(self, who: str, text: str) -> tuple[ControlChange, str]:
        """Return the change that an order asks for, and what the model says of it; do nothing yet.

        Args:
            who: name of the operator.
            text: the order, as `rig.configuration.ordered_control` reads it.

        Raises:
            RefusedError: the order cannot be used, changes nothing, leaves less than the least
                margins by the model, and less than the present control leaves, or is expected to
                let the ram follow much worse than under the present control and the gain alone.
        """
        if self._test.setpoint.quantity != "position":
            why = "the setpoint of the running test is the valve command, so no position loop runs"
            raise RefusedError(f"{why}; wait for a test in closed loop")
        try:
            after = ordered_control(text, self.settings)
        except ConfigError as error:
            raise RefusedError(str(error)) from None
        if after.gain is None:
            after = replace(after, gain=self._rig.gain_V_per_m)
        change = ControlChange(who, self.settings, after)
        if not str(change):
            raise RefusedError("the control of the running test has these values already")
        return change, self._judged(change)

    def __str__(self) -> str:
        """Return the keys whose values are not the usual ones, with these values."""
        return control_in_words(self.settings)

    def add(self, change: ControlChange) -> None:
        """Let a change that `asked` returned wait for the loop."""
        self.settings = change.after
        self._waiting.append(change)

    @property
    def next_s(self) -> float:
        """The time of the test at which its file changes the control next, s; inf if never."""
        return self._coming[0].at_s if self._coming else inf

    def take(self, time_s: float) -> list[ControlChange]:
        """Return the changes that are due at a time of the test, s, in their order; forget them.

        They are what operators have asked for, and then what the file asks for up to that time,
        which takes the place of all that was set before.
        """
        self._now_s = time_s
        while self._coming and self._coming[0].at_s <= time_s + _INSTANT_S:
            after = self._coming.pop(0).control
            after = replace(after, gain=after.gain or self._first_gain)
            if after != self.settings:
                self.add(ControlChange(_CAMPAIGN, self.settings, after))
        waiting, self._waiting = self._waiting, []
        return waiting

    def _judged(self, change: ControlChange) -> str:
        """Return in words which margins and error a change leaves by the model; refuse bad ones."""
        found = self._margins(change.after)
        leaves = margins_in_words(found)
        if found.kept:
            return f"by the model it leaves {leaves}; {self._foreseen(change)}"
        present = self._margins(change.before)
        if found.gain_dB >= present.gain_dB and found.phase >= present.phase:
            but = "too little, but more than before"
            return f"by the model it leaves {leaves}, {but}; {self._foreseen(change)}"
        raise RefusedError(
            f"set control: {change} leaves {leaves} by the model, below the 6 dB and 30 degrees "
            f"that a loop must keep; {self._remedy(change.after)}"
        )

    def _foreseen(self, change: ControlChange) -> str:
        """Return in words which error is expected under a change; refuse one that is a mistake."""
        new = self._expected(change.after)
        others = []
        # The other controls are computed only as long as the change is not better than one of them.
        for settings in (ControlSettings(gain=change.after.gain), change.before):
            others.append(self._expected(settings))
            if not is_mistaken(new, tuple(others), change.after):
                return f"expected following error at most {new}"
        alone, present = others
        raise RefusedError(
            f"set control: {change} is expected to let the ram be off by {new}; the present "
            f"control by {present}, the gain alone by {alone}; look at feedforward_gain, null and "
            "deadband"
        )

    def _expected(self, settings: ControlSettings) -> Expected:
        """Return the error that is expected of the test's next time, or of its last."""
        gain = settings.gain or self._rig.gain_V_per_m
        latest_s = max(0.0, self._test.duration_s - _FORESEEN_S)
        begin_s = min(self._now_s, latest_s)
        return expected_error(
            self._test, settings, gain, self._rig, self._assumed, begin_s, begin_s + _FORESEEN_S
        )

    def _margins(self, settings: ControlSettings) -> Margins:
        gain = settings.gain or self._rig.gain_V_per_m
        return margins_by_model(settings, gain, self._rig, self._assumed.parameters)

    def _remedy(self, settings: ControlSettings) -> str:
        gain = settings.gain or self._rig.gain_V_per_m
        return remedy_of_margins(settings, gain, self._rig, self._assumed.parameters)
