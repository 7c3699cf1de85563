"""The control of the running test: what operators may ask for, and what waits for the loop."""

from dataclasses import dataclass, replace
from math import degrees
from typing import Final

from control import ControlSettings, Margins, least_margins
from faults import CampaignTest
from rig.configuration import ConfigError, Rig, control_in_words, ordered_control
from rig.plant import TICK, Model
from rig.supervisor import control_for

from .operator_requests import RefusedError

_PLACES: Final = (0.0, 0.5, 1.0)
"""Places at which the margins are looked at, as parts of the way between the position limits. The
oil's resonance is lowest near the middle and highest at an end."""
_STEP: Final = 0.95
_STEPS: Final = 90
"""Factor and number of the steps by which a smaller gain is looked for that keeps the margins: down
to a hundredth of the gain that was asked for, within half a second."""


@dataclass(frozen=True)
class ControlChange:
    """A change of the running test's control that an operator has asked for.

    Attributes:
        who: name of the operator.
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
        self.settings = control_for(rig, test)

    def asked(self, who: str, text: str) -> tuple[ControlChange, str]:
        """Return the change that an order asks for, and what the model says of it; do nothing yet.

        Args:
            who: name of the operator.
            text: the order, as `rig.configuration.ordered_control` reads it.

        Raises:
            RefusedError: the order cannot be used, changes nothing, or leaves less than the
                least margins by the model, and less than the present control leaves.
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

    def take(self) -> list[ControlChange]:
        """Return the changes that wait, in the order in which they were asked for; forget them."""
        waiting, self._waiting = self._waiting, []
        return waiting

    def _judged(self, change: ControlChange) -> str:
        """Return in words which margins a change leaves by the model; refuse too small ones."""
        found = self._margins(change.after)
        if found.kept:
            return f"by the model it leaves {_in_words(found)}"
        present = self._margins(change.before)
        if found.gain_dB >= present.gain_dB and found.phase >= present.phase:
            return f"by the model it leaves {_in_words(found)}, too little, but more than before"
        raise RefusedError(
            f"set control: {change} leaves {_in_words(found)} by the model, below the 6 dB and 30 "
            f"degrees that a loop must keep; {self._remedy(change.after)}"
        )

    def _margins(self, settings: ControlSettings) -> Margins:
        limits, rig = self._rig.limits, self._rig
        width = limits.position_max_m - limits.position_min_m
        # On hardware a command follows from the sample before it (docs/decisions/0007).
        return least_margins(
            settings,
            settings.gain or rig.gain_V_per_m,
            self._assumed.parameters,
            TICK if rig.backend == "hardware" else 0.0,
            tuple(limits.position_min_m + step * width for step in _PLACES),
        )

    def _remedy(self, settings: ControlSettings) -> str:
        gain = settings.gain or self._rig.gain_V_per_m
        for _ in range(_STEPS):
            gain *= _STEP
            if self._margins(replace(settings, gain=gain)).kept:
                return f"the greatest gain that keeps them is about {gain:.3g} V/m"
        return "give it a longer integral_time, or less deadband"


def _in_words(margins: Margins) -> str:
    if margins.gain_dB <= 0.0 or margins.phase <= 0.0:
        return "no margin at all"
    return f"{margins.gain_dB:.1f} dB and {degrees(margins.phase):.0f} degrees"
