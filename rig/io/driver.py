"""The protocols that every driver of hardware fulfils, and the error that all drivers raise.

Third parties add a driver by an entry point of the group `hydraulic_rig.drivers` that names its
class. The driver should pass the checks of `rig.io.conformance`.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class DriverError(Exception):
    """Raised when a driver cannot do what it is asked to do.

    Args:
        driver: name of the driver in the rig file.
        state: what is wrong, with value and limit.
        action: what to do about it.
        channel: the signal or address concerned; empty if there is none.
    """

    def __init__(self, driver: str, state: str, action: str, channel: str = "") -> None:
        self.driver, self.channel, self.state, self.action = driver, channel, state, action
        where = f"{driver}, {channel}" if channel else driver
        super().__init__(f"{where}: {state}; {action}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.driver, self.state, self.action, self.channel)


@runtime_checkable
class Driver(Protocol):
    """What the driver of a device must offer; a driver of kind "fast" must be a `FastDriver`.

    A driver moves nothing before the first `write`. Its class is called with the driver's name in
    the rig file and with its `options`, a frozen dataclass of the class `Options`, whose fields are
    the keys of the driver's section there. A field is a `str`, `int`, `bool`, `Path`, `Literal`, a
    `rig.io.modbus_daq.register_map.RegisterMap` (given by name) or a float `Annotated` with a
    `rig.plant.parameters.Quantity`, by which its unit and limits are checked.

    Attributes:
        kind: "fast" for the driver with which the loop exchanges samples, "slow" for the others,
            which the field process serves.
        Options: the class of the driver's options.
        name: name of the driver in the rig file; errors begin with it.
        inputs: names in `rig.io.signals` of the signals that the driver reads.
        outputs: names there of the signals that the driver writes.
        rate_hz: greatest rate in Hz at which the loop or the field process may read and write.
    """

    kind: ClassVar[Literal["fast", "slow"]]
    Options: ClassVar[type]

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rate_hz: float

    def open(self) -> None:
        """Connect, verify that the device is the one expected, and set it up.

        Nothing moves. If the driver is open already, nothing is done.

        Raises:
            DriverError: no device answers, another device does, or the device cannot do what is
                configured.
        """

    def read(self) -> Mapping[str, float]:
        """Return the values that came in since the last call, by signal, SI; NaN if invalid.

        A signal of which no value came is left out.

        Raises:
            DriverError: the driver is not open, the device is lost or reports a fault, or a move
                did not end in time.
        """

    def write(self, outputs: Mapping[str, float]) -> None:
        """Set outputs, given by signal in SI, without waiting for the end of a move.

        Outputs that are not given keep their values.

        Raises:
            DriverError: an output is unknown or its value not possible, and then nothing is sent;
                or the driver is not open, or the device is lost, or refuses.
        """

    def safe_state(self) -> None:
        """Bring every output to its safe state, and return when the device has confirmed that.

        In the safe state the valve is at null and disabled, the bypasses are shut and the pump is
        unloaded. The call works whatever happened before, over a new connection if need be.
        Repeated calls do no harm.

        Raises:
            DriverError: the device did not confirm its safe state.
        """

    def close(self) -> None:
        """Close the connection to the device; repeated calls do no harm."""


class ExchangeStatus(IntEnum):
    """How an exchange with a device ended; its inputs are NaN unless it gave a reply as asked."""

    OK = 0
    """The device has replied as asked."""
    TIMEOUT = 1
    """No whole reply came before the deadline; a reply that comes later is dropped."""
    EXCEPTION = 2
    """The device refused the request."""
    WRONG_REPLY = 3
    """A whole reply came, but it does not answer this request."""
    DISCONNECTED = 4
    """The connection is closed, or took only a part of the request."""
    GARBAGE = 5
    """Bytes came that no such device sends; all of them were dropped."""
    FOREIGN_WRITE = 6
    """The device has replied as asked, and says that it refused what another master wrote. The
    inputs are those of the reply."""
    NOT_OWNER = 7
    """The device does what another master writes, or nobody's, but not what this program writes."""


@runtime_checkable
class Plan(Protocol):
    """An exchange prepared for one connection; compiled code runs it, and may change its arrays.

    A plan is an instance of a `NamedTuple` of arrays and numbers. Its class has the method
    `exchange`, decorated with `njit(cache=True, error_model="numpy", nogil=True)`.
    """

    def exchange(
        self, fd: int, sequence: int, outputs: Floats, inputs: Floats, deadline_ns: int
    ) -> tuple[int, int]:
        """Write the outputs to the device and read its inputs, waiting for nothing but its reply.

        Args:
            fd: the driver's `fileno()`.
            sequence: number of the exchange, greater by 1 each time; the plan and the look plan of
                a driver share one count.
            outputs: float64 (len(FAST_OUTPUTS),), values of `FAST_OUTPUTS`, SI.
            inputs: float64 (len(FAST_INPUTS),), filled with the values of `FAST_INPUTS`, SI; NaN
                for signals that the device lacks, and all NaN unless the status is OK.
            deadline_ns: time on CLOCK_MONOTONIC in ns at which the exchange gives up.

        Returns:
            The `ExchangeStatus`, and the time on CLOCK_MONOTONIC in ns at which the command left,
            0 if it did not leave.
        """


@runtime_checkable
class FastDriver(Driver, Protocol):
    """What a driver of kind "fast" must offer, so that the loop exchanges a sample at every tick.

    `read` and `write` are for callers that have no loop. The loop takes the plans and the
    connection before it starts, and calls no method of the driver while it runs.
    """

    def fileno(self) -> int:
        """Return the descriptor of the connection over which the plans exchange samples.

        It is in blocking mode. A driver whose exchange needs no descriptor returns any number from
        0 on.

        Raises:
            DriverError: the device is not open.
        """

    def plan(self) -> Plan:
        """Return the plan of the exchange, which is the same at every call, also before `open`."""

    def look_plan(self) -> Plan:
        """Return a plan of the type of `plan()` whose exchange reads inputs and writes no output.

        With it the loop checks that a valve at null has stayed there, before it sends null again.
        """

    def driven(self) -> str:
        """Return a text that names what of the valve is not at null; empty if all is at null.

        The state is read over a new connection.

        Raises:
            DriverError: the device does not answer.
        """
