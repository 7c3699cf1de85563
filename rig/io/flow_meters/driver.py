"""The driver of the leak-flow meters: three meters on one serial line, which are only read."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import nan
from typing import Annotated, ClassVar, Final, Literal

import serial

from rig.io.driver import DriverError
from rig.io.signals import METERS
from rig.plant import Quantity as _Quantity

from .lines import MeterLineParser

_FIRST_RETRY_S: Final = 0.1
_LAST_RETRY_S: Final = 2.0
"""Longest wait before an unplugged line is opened again; the wait doubles after each attempt."""

_READ_BYTES: Final = 4096
"""Bytes to read at once, more than come between two readings at any rate that is allowed."""

_LOOK_S: Final = 0.02


@dataclass(frozen=True)
class FlowMeterOptions:
    """Keys of the flow meters in a rig file.

    Attributes:
        port: serial port.
        baud: baud rate of the line, which has 8 data bits, no parity and 1 stop bit.
        rate: how often the line is read; the meters themselves send their flow 10 times a second.
        stale: silence of a meter after which its value is missing.
    """

    port: str
    baud: Annotated[int, _Quantity("", 1200, 1_000_000, "", "")] = 9600
    rate: Annotated[float, _Quantity("Hz", 1.0, 100.0, "", "")] = 20.0
    stale: Annotated[float, _Quantity("s", 0.2, 10.0, "", "")] = 0.5


class FlowMeters:
    """The driver of a rig's leak-flow meters; meters 1, 2 and 3 are the signals `METERS` in order.

    An unplugged line is no error: its meters read NaN until it is plugged in again.

    Args:
        name: name of the driver in the rig file.
        options: the driver's section there.
        clock: returns the time in ns.
        sleep: waits for a time in s; only `open` uses it.
    """

    kind: ClassVar[Literal["fast", "slow"]] = "slow"
    Options: ClassVar[type] = FlowMeterOptions

    def __init__(
        self,
        name: str,
        options: FlowMeterOptions,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.name = name
        self.inputs: tuple[str, ...] = METERS
        self.outputs: tuple[str, ...] = ()
        self.rate_hz = options.rate
        self._options = options
        self._stale_ns = round(options.stale * 1e9)
        self._clock = clock
        self._sleep = sleep
        self._parser = MeterLineParser()
        self._is_open = False
        self._port: serial.Serial | None = None
        self._heard_ns: dict[str, int] = {}
        self._retry_s = _FIRST_RETRY_S
        self._retry_ns = 0

    def open(self) -> None:
        """Open the serial line, and wait until a valid text line of a meter has come.

        If the driver is open already, nothing is done.

        Raises:
            DriverError: the port cannot be opened or is lost, or no valid line comes in `stale`.
        """
        if self._is_open:
            return
        try:
            self._port = self._plugged()
        except OSError as error:
            action = "check the plug, the path and who else uses it"
            raise self._error(f"cannot be opened: {error}", action) from error
        self._is_open = True
        now = self._clock()
        self._heard_ns = dict.fromkeys(METERS, now)
        while not self._take():
            if self._port is None or self._clock() - now > self._stale_ns:
                self.close()
                counts = self._parser.counts
                raise self._error(
                    f"no valid line within {self._options.stale:g} s "
                    f"({counts.malformed + counts.checksum_errors} others)",
                    "check that the meters are on, and the baud rate",
                )
            self._sleep(_LOOK_S)

    def read(self) -> Mapping[str, float]:
        """Return the newest flows in m^3/s that came since the last call, by signal.

        A meter of which none came is left out until it has been silent for `stale`, and is NaN from
        then on. A meter with a failed sensor is NaN. A lost line is opened again if possible.

        Raises:
            DriverError: the driver is not open.
        """
        if not self._is_open:
            raise DriverError(self.name, "is not open", "open it first")
        self._replug()
        flows = self._take()
        now = self._clock()
        for signal, heard_ns in self._heard_ns.items():
            if signal not in flows and now - heard_ns > self._stale_ns:
                flows[signal] = nan
        return flows

    def write(self, outputs: Mapping[str, float]) -> None:
        """Refuse every output, since the meters have none; do nothing if none is given.

        Raises:
            DriverError: an output is given.
        """
        if outputs:
            action = "write nothing: it only reads"
            raise DriverError(self.name, "is not an output", action, ", ".join(outputs))

    def safe_state(self) -> None:
        """Do nothing, since the meters move nothing."""

    def close(self) -> None:
        """Close the line; repeated calls do no harm."""
        self._is_open = False
        self._let_go()

    def _plugged(self) -> serial.Serial:
        # Opening discards the bytes that were waiting in the line.
        return serial.Serial(self._options.port, self._options.baud, timeout=0, exclusive=True)

    def _take(self) -> dict[str, float]:
        """Return the newest flow in m^3/s of each meter that sent one, by signal, without waiting.

        A line that can no longer be read is closed, and the result is empty.
        """
        if self._port is None:
            return {}
        try:
            data = self._port.read(_READ_BYTES)
        except OSError:
            self._let_go()
            self._wait(_FIRST_RETRY_S)
            return {}
        flows = {METERS[line.meter - 1]: line.flow for line in self._parser.feed(data)}
        self._heard_ns.update(dict.fromkeys(flows, self._clock()))
        return flows

    def _wait(self, wait_s: float) -> None:
        """Allow the next attempt to open the line only after a time in s; return at once."""
        self._retry_s = wait_s
        self._retry_ns = self._clock() + round(wait_s * 1e9)

    def _replug(self) -> None:
        """Try to open a lost line again, if the wait since the last attempt is over."""
        if self._port is not None or self._clock() < self._retry_ns:
            return
        try:
            self._port = self._plugged()
        except OSError:
            self._wait(min(2.0 * self._retry_s, _LAST_RETRY_S))

    def _let_go(self) -> None:
        if self._port is not None:
            self._port.close()
            self._port = None

    def _error(self, state: str, action: str) -> DriverError:
        return DriverError(self.name, f"{self._options.port}: {state}", action)
