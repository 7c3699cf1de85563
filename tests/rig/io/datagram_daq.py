"""A fast driver with an exchange of its own, as a third party's package would have it.

A request is an array of float64: the number of the exchange, then `FAST_OUTPUTS`. A look, which
only reads, has no outputs. The reply has the same number, then `FAST_INPUTS`. Tests install this
file as a package; the driver exists for them alone.
"""

import socket
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from math import isfinite
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.io.driver import DriverError, ExchangeStatus
from rig.io.libc import monotonic_ns, receive, send, wait_readable
from rig.io.signals import FAST_INPUTS, FAST_OUTPUTS
from rig.plant.parameters import Quantity

Floats = NDArray[np.float64]

OK = int(ExchangeStatus.OK)
TIMEOUT = int(ExchangeStatus.TIMEOUT)
DISCONNECTED = int(ExchangeStatus.DISCONNECTED)


class DatagramPlan(NamedTuple):
    """Arrays (float64) for a request and its reply; a request without outputs is a look."""

    request: Floats
    reply: Floats

    @njit(cache=True, error_model="numpy", nogil=True)
    def exchange(self, fd, sequence, outputs, inputs, deadline_ns):
        """Exchange one datagram each way; see `rig.io.driver.Plan.exchange`."""
        inputs[:] = np.nan
        request, reply = self.request, self.reply
        request[0] = sequence
        request[1:] = outputs[: request.size - 1]
        frame, answer = request.view(np.uint8), reply.view(np.uint8)
        if send(fd, frame, 0, frame.size) < 0:
            return DISCONNECTED, 0
        sent_ns = monotonic_ns()
        while wait_readable(fd, deadline_ns):
            if receive(fd, answer, 0) < 0:
                return DISCONNECTED, sent_ns
            if reply[0] == sequence:
                inputs[:] = reply[1:]
                return OK, sent_ns
            # This is the late reply to an earlier exchange that timed out, so wait for the next.
        return TIMEOUT, sent_ns


def plan_of(outputs: int) -> DatagramPlan:
    """Return the plan of an exchange with `outputs` outputs; 0 makes a look."""
    return DatagramPlan(np.zeros(1 + outputs), np.zeros(1 + len(FAST_INPUTS)))


@dataclass(frozen=True)
class DatagramOptions:
    """The options of the driver in a rig file."""

    port: Annotated[int, Quantity("", 1, 65535, "", "")]
    host: str = "127.0.0.1"
    timeout: Annotated[float, Quantity("s", 0.01, 60.0, "", "")] = 1.0


class DatagramDaq:
    """A driver of a device that answers datagrams and obeys enable and command at once."""

    kind: ClassVar[Literal["fast", "slow"]] = "fast"
    Options: ClassVar[type] = DatagramOptions

    def __init__(self, name: str, options: DatagramOptions) -> None:
        self.name = name
        self.inputs: tuple[str, ...] = (
            "position_m", "pressure_1_Pa", "pressure_2_Pa", "spool_m", "supply_pressure_Pa",
            "valve_enabled", "device_counter", "device_echo", "device_command_V",
        )  # fmt: skip
        self.outputs: tuple[str, ...] = FAST_OUTPUTS
        self.rate_hz = 1000.0
        self._options = options
        self._socket: socket.socket | None = None
        self._plan, self._look = plan_of(len(FAST_OUTPUTS)), plan_of(0)
        self._given = np.zeros(len(FAST_OUTPUTS))
        self._sequence = 0

    def open(self) -> None:
        """Connect, and check by a look that the device answers.

        Raises:
            DriverError: it does not answer.
        """
        if self._socket is None:
            connection = self._connected()
            try:
                self._exchanged(connection, self._look)
            except DriverError:
                connection.close()
                raise
            self._socket = connection

    def fileno(self) -> int:
        """Return the file descriptor of the connection."""
        return self._opened().fileno()

    def plan(self) -> DatagramPlan:
        """Return the plan of an exchange that writes outputs and reads inputs."""
        return self._plan

    def look_plan(self) -> DatagramPlan:
        """Return the plan of a look, which only reads inputs."""
        return self._look

    def read(self) -> Mapping[str, float]:
        """Return the present inputs by signal."""
        return self._exchanged(self._opened(), self._look)

    def write(self, outputs: Mapping[str, float]) -> None:
        """Set the given outputs; the others keep their values.

        Raises:
            DriverError: a signal is no output, a value is not finite, or the device is silent.
        """
        for signal, value in outputs.items():
            if signal not in self.outputs or not isfinite(value):
                action = f"write finite values to {', '.join(self.outputs)}"
                raise DriverError(self.name, f"cannot be set to {value}", action, signal)
        connection = self._opened()
        for signal, value in outputs.items():
            self._given[FAST_OUTPUTS.index(signal)] = value
        self._exchanged(connection, self._plan)

    def safe_state(self) -> None:
        """Null and disable the valve over a new connection.

        Raises:
            DriverError: the valve is not at null afterwards, or the device does not answer.
        """
        self._given[:] = 0.0
        with self._apart() as connection:
            self._exchanged(connection, plan_of(len(FAST_OUTPUTS)))
        if still := self.driven():
            state = f"was sent null, and still has {still}"
            raise DriverError(self.name, state, "cut the hydraulic supply")

    def driven(self) -> str:
        """Return a text on the first signal of the valve that is not at null; "" if all are."""
        with self._apart() as connection:
            found = self._exchanged(connection, plan_of(0))
        driven = (name for name in ("device_command_V", "valve_enabled") if found[name] != 0.0)
        return next((f"{name} at {found[name]:g}" for name in driven), "")

    def close(self) -> None:
        """Close the connection."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _opened(self) -> socket.socket:
        if self._socket is None:
            raise DriverError(self.name, "is not open", "open it first")
        return self._socket

    def _connected(self) -> socket.socket:
        connection = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        connection.connect((self._options.host, self._options.port))
        return connection

    @contextmanager
    def _apart(self) -> Iterator[socket.socket]:
        with self._connected() as connection:
            yield connection

    def _exchanged(self, connection: socket.socket, plan: DatagramPlan) -> Mapping[str, float]:
        """Make one exchange by a plan; return the inputs by signal, or raise DriverError."""
        self._sequence += 1
        found = np.zeros(len(FAST_INPUTS))
        deadline = time.monotonic_ns() + round(1e9 * self._options.timeout)
        status, _ = plan.exchange(connection.fileno(), self._sequence, self._given, found, deadline)
        if status != OK:
            state = f"does not answer: {ExchangeStatus(status).name}"
            raise DriverError(self.name, state, "check power and cable")
        return {name: float(found[FAST_INPUTS.index(name)]) for name in self.inputs}
