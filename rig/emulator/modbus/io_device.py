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
        enabled: whether the valve's relay is closed.
        connections: number of its clients, which the server sets.
        frozen: whether its converters hang, so that it returns its last sample again and again.
        exchanges: number of times that its host has written outputs.
        estop_closed: whether the emergency stop's chain is closed.
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
        self._zero = instruments.encoder_counts()
        self._encoder_fault = self._button = self._tripped = False
        self.estop_closed = True
        self.enabled = False
        self._samples = 0
        self._output = 0.0

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
    def tend(self) -> int:
        """Make the watchdog trip if its time is over, and return the present in ns."""

    @property
    @abstractmethod
    def lamp(self) -> bool:
        """Whether the reset lamp is lit."""

    @abstractmethod
    def press_reset(self, pressed: bool) -> None:
        """Press the reset button, or release it."""

    @abstractmethod
    def _asked(self) -> tuple[bool, float, float]:
        """Return whether the relay may close, the host's command, and the output that follows.

        Command and output are in V; the output is that with a closed relay. The emergency stop is
        not taken into account.
        """

    def press_estop(self, pressed: bool) -> None:
        """Open the emergency stop's chain if `pressed`, else close it."""
        now = self.tend()
        self.estop_closed = not pressed
        self._record.note("estop_opened" if pressed else "estop_closed", now)
        self._settle("estop", now)

    def _settle(self, cause: str, at_ns: int) -> None:
        """Set relay and valve output to what host, emergency stop and device allow.

        A change of the relay is recorded as of `at_ns`, an opening with `cause`. A change of the
        output is passed on to the valve, from `at_ns` on.
        """
        allowed, command, output = self._asked()
        enabled = allowed and self.estop_closed
        if enabled and not self.enabled:
            self._record.note("valve_enabled", at_ns, command_V=command)
        elif self.enabled and not enabled:
            self._record.note("valve_disabled", at_ns, cause=cause, output_V=0.0)
        self.enabled = enabled
        output = output if enabled else 0.0
        if output != self._output:
            self._output = output
            self._valve(output, at_ns)

    def lose_counts(self, counts: int, flagged: bool) -> None:
        """Make the encoder lose counts for good; with `flagged` its interface reports a fault."""
        self._zero += counts
        self._encoder_fault = self._encoder_fault or flagged
        self._record.note("encoder_counts_lost", counts=counts, flagged=flagged)

    @abstractmethod
    def state(self) -> dict[str, object]:
        """Return the state of the device for the control port and the record."""
