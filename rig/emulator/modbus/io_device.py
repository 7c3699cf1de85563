"""What the emulated rig needs of its I/O device, whichever it is."""

from typing import Protocol

from .functions import Device


class IoDevice(Device, Protocol):
    """A Modbus device that transducers, valve, buttons and lamp are wired to.

    Attributes:
        frozen: its converters hang: it returns its last sample for ever.
        exchanges: how often its host has written.
    """

    frozen: bool
    exchanges: int

    def tend(self) -> None:
        """Let the watchdog trip if its time has come."""

    def press_estop(self, pressed: bool) -> None:
        """Open the emergency stop's chain, or close it again."""

    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or let it go."""

    def lose_counts(self, counts: int, flagged: bool) -> None:
        """Let the encoder lose counts; `flagged` if its interface notices."""

    @property
    def lamp(self) -> bool:
        """Whether the reset lamp is lit."""

    @property
    def estop_closed(self) -> bool:
        """Whether the emergency stop's chain is closed."""

    @property
    def enabled(self) -> bool:
        """Whether the valve's relay is closed."""

    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
