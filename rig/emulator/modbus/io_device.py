"""The base class of the emulated I/O devices: what is wired to them, and what they can be asked."""

from abc import ABC, abstractmethod
from collections.abc import Callable

from rig.emulator.instruments import Instruments
from rig.emulator.record import Record


class IoDevice(ABC):
    """A Modbus device to which transducers, valve, buttons and lamp are wired.

    Args:
        instruments: the transducers.
        valve: called with the voltage at the valve and the time in ns from which it acts.
        record: takes note of what happens.

    Attributes:
        functions: codes of the Modbus functions that the device serves.
        connections: number of its clients.
        frozen: whether its converters hang, so that it returns its last sample again and again.
        exchanges: number of times that its host has written outputs.
    """

    functions: frozenset[int]

    def __init__(
        self, instruments: Instruments, valve: Callable[[float, int], None], record: Record
    ) -> None:
        self.connections = self.exchanges = 0
        self.frozen = False
        self._instruments = instruments
        self._clock = instruments.plant.clock
        self._valve = valve
        self._record = record
        self._zero = instruments.plant.encoder_counts()
        self._encoder_fault = self._button = self._tripped = False
        self._estop_closed = True
        self._samples = 0

    @abstractmethod
    def has(self, address: int, count: int) -> bool:
        """Return whether `count` registers from `address` on can be read."""

    @abstractmethod
    def read(self, address: int, count: int) -> bytes:
        """Return registers, high byte first; take a new sample if inputs are among them.

        While the device is `frozen`, no new sample is taken.

        Raises:
            ModbusException: there are no such registers.
        """

    @abstractmethod
    def write(self, address: int, data: bytes) -> None:
        """Write registers, high byte first: all of them, or none if an exception is raised.

        Raises:
            ModbusException: there are no such registers to write, or a value is refused.
        """

    @abstractmethod
    def tend(self) -> None:
        """Make the watchdog trip if its time is over."""

    @abstractmethod
    def press_estop(self, pressed: bool) -> None:
        """Open the emergency stop's chain if `pressed`, else close it."""

    @abstractmethod
    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or release it."""

    def lose_counts(self, counts: int, flagged: bool) -> None:
        """Make the encoder lose counts for good; with `flagged` its interface reports a fault."""
        self._zero += counts
        self._encoder_fault = self._encoder_fault or flagged
        self._record.note("encoder_counts_lost", counts=counts, flagged=flagged)

    @property
    @abstractmethod
    def lamp(self) -> bool:
        """Whether the reset lamp is lit."""

    @property
    def estop_closed(self) -> bool:
        """Whether the emergency stop's chain is closed."""
        return self._estop_closed

    @property
    @abstractmethod
    def enabled(self) -> bool:
        """Whether the valve's relay is closed."""

    @abstractmethod
    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
