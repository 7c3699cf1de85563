"""The emulated operator, who presses the reset button when its lamp is lit, if he is attentive."""

from typing import Final

from rig.emulator.modbus import IoDevice

from .plant import Clock

_REACTION_NS: Final = 200_000_000
"""Time in ns for which the lamp is lit before he presses; it is chosen, and short for a person."""
_PRESS_NS: Final = 100_000_000


class EmulatedOperator:
    """Answers the reset lamp with the reset button.

    Args:
        node: device to which lamp and button are wired.
        clock: returns the time in ns.
        attentive: whether he presses by himself whenever the lamp is lit.
    """

    def __init__(self, node: IoDevice, clock: Clock, attentive: bool) -> None:
        self.attentive = attentive
        self._node = node
        self._clock = clock
        self._lit_ns: int | None = None
        self._pressed_ns: int | None = None

    def tend(self) -> None:
        """Look at the lamp, and press or release the button if it is time.

        An attentive operator presses once the lamp has been lit for 0.2 s with the emergency stop's
        chain closed. A pressed button is released after 0.1 s.
        """
        now = self._clock()
        if self._pressed_ns is not None:
            if now - self._pressed_ns >= _PRESS_NS:
                self._node.press_reset(False)
                self._pressed_ns = self._lit_ns = None
        elif not (self.attentive and self._node.lamp and self._node.estop_closed):
            self._lit_ns = None
        elif self._lit_ns is None:
            self._lit_ns = now
        elif now - self._lit_ns >= _REACTION_NS:
            self.press()

    def press(self) -> None:
        """Press the reset button now; a later `tend` releases it."""
        self._node.press_reset(True)
        self._pressed_ns = self._clock()
