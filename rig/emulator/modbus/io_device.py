"""What the emulated I/O devices have in common: what is wired to them, and what the rig asks."""

from abc import ABC, abstractmethod
from collections.abc import Callable

from rig.emulator.instruments import Instruments
from rig.emulator.record import Record


class IoDevice(ABC):
    """A Modbus device that transducers, valve, buttons and lamp are wired to.

    Args:
        instruments: the transducers.
        valve: takes the voltage at the valve, and the moment in ns from which it stands there.
        record: takes note of what happens.

    Attributes:
        functions: Modbus functions it serves.
        connections: how many clients it has.
        frozen: its converters hang: it returns its last sample for ever.
        exchanges: how often its host has written outputs.
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
        """Return whether there are registers to read there."""

    @abstractmethod
    def read(self, address: int, count: int) -> bytes:
        """Return registers, high byte first; sample the instruments if inputs are among them.

        Raises:
            ModbusException: there are no such registers.
        """

    @abstractmethod
    def write(self, address: int, data: bytes) -> None:
        """Write registers, high byte first; all of them or, with an exception, none.

        Raises:
            ModbusException: there are no such registers to write, or a value is refused.
        """

    @abstractmethod
    def tend(self) -> None:
        """Let the watchdog trip if its time has come."""

    @abstractmethod
    def press_estop(self, pressed: bool) -> None:
        """Open the emergency stop's chain, or close it again."""

    @abstractmethod
    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or let it go."""

    def lose_counts(self, counts: int, flagged: bool) -> None:
        """Let the encoder lose counts; `flagged` if its interface notices."""
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
