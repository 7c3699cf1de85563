"""What a driver is: the protocols to hardware, and the error that all drivers raise.

Third parties add a driver by an entry point of the group `hydraulic_rig.drivers` that names its
class; `rig.io.conformance` is the suite that it should pass.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class DriverError(Exception):
    """A driver that cannot do what is asked of it.

    Args:
        driver: name of the driver in the rig file.
        state: what is wrong, with value and limit.
        action: what to do about it.
        channel: the signal or address concerned, if it is one.
    """

    def __init__(self, driver: str, state: str, action: str, channel: str = "") -> None:
        self.driver, self.channel, self.state, self.action = driver, channel, state, action
        where = f"{driver}, {channel}" if channel else driver
        super().__init__(f"{where}: {state}; {action}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.driver, self.state, self.action, self.channel)


@runtime_checkable
class Driver(Protocol):
    """A device of the rig; a fast one is a `FastDriver`. Nothing moves before the first `write`.

    The class is made with its name in the rig file and its `options`, a frozen dataclass whose
    fields are the keys of its section there: `str`, `int`, `bool`, `Path`, `Literal`, a
    `rig.io.modbus_daq.register_map.RegisterMap` (given by name) or float `Annotated` with a
    `rig.plant.parameters.Quantity`, from which its unit and limits are checked.

    Attributes:
        kind: "fast" for the one that the loop exchanges samples with, "slow" for the others, which
            the field process serves.
        name: its name in the rig file; errors begin with it.
        inputs: names in `rig.io.signals` that it reads.
        outputs: names there that it writes.
        rate_hz: how often it can be read and written; the loop or field process asks no more often.
    """

    kind: ClassVar[Literal["fast", "slow"]]
    Options: ClassVar[type]

    name: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    rate_hz: float

    def open(self) -> None:
        """Connect, verify that it is the device expected, and set it up.

        Raises:
            DriverError: no such device, another one, or one that cannot do what is configured.
        """

    def read(self) -> Mapping[str, float]:
        """Return what has come in since the last call, by signal, SI; NaN for an invalid value.

        Raises:
            DriverError: the device is lost, or a move did not end in time.
        """

    def write(self, outputs: Mapping[str, float]) -> None:
        """Set outputs by signal; begins a move where one takes time, and does not wait for it.

        Raises:
            DriverError: the device is lost, or refuses.
        """

    def safe_state(self) -> None:
        """Bring every output to its safe state: valve at null and disabled, bypass shut, unloaded.

        Works whatever happened before, by a new connection if need be, and returns when the device
        has confirmed it; repeated calls do no harm.

        Raises:
            DriverError: it was not confirmed.
        """

    def close(self) -> None:
        """Let go of the device; harmless when repeated."""


class ExchangeStatus(IntEnum):
    """How an exchange ended; after any but OK its inputs are NaN."""

    OK = 0
    TIMEOUT = 1
    """No whole reply until the deadline; if it comes later, it is dropped."""
    EXCEPTION = 2
    """The device refused."""
    WRONG_REPLY = 3
    """A whole reply, but not to this request."""
    DISCONNECTED = 4
    """The connection is gone, or cannot take a whole frame."""
    GARBAGE = 5
    """The bytes that came cannot be from the device; all of them were dropped."""


@runtime_checkable
class Plan(Protocol):
    """An exchange prepared for one connection; compiled code takes it, and may change its arrays.

    It is an instance of a `NamedTuple` of arrays and numbers. The class has the exchange as a
    method that numba compiles, by `njit(cache=True, error_model="numpy", nogil=True)`.
    """

    def exchange(
        self, fd: int, sequence: int, outputs: Floats, inputs: Floats, deadline_ns: int
    ) -> tuple[int, int]:
        """Write outputs and read inputs in the device, and wait for nothing but its reply.

        Args:
            fd: the driver's `fileno()`.
            sequence: number of the exchange; plan and look plan of a driver count up together.
            outputs: (outputs,), `FAST_OUTPUTS`, SI.
            inputs: (inputs,), filled with `FAST_INPUTS`, SI; NaN where the device has no such
                signal, and all NaN unless the status is OK.
            deadline_ns: when to give up, on CLOCK_MONOTONIC.

        Returns:
            The `ExchangeStatus`, and when the command left, CLOCK_MONOTONIC in ns; 0 if it did not.
        """


@runtime_checkable
class FastDriver(Driver, Protocol):
    """The driver of kind "fast": the loop exchanges a sample with its device at every tick.

    `read` and `write` serve whoever has no loop. The loop takes the plans and the connection, and
    calls none of this while it runs.
    """

    def fileno(self) -> int:
        """Return the connection that samples are exchanged over, for the plans' exchange.

        It is a descriptor in blocking mode, or any number from 0 on if the exchange needs none.

        Raises:
            DriverError: the device is not open.
        """

    def plan(self) -> Plan:
        """Return the plan of the exchange over this connection, open or not; always the same."""

    def look_plan(self) -> Plan:
        """Return the plan of an exchange that reads the inputs and writes nothing; the same type.

        By it the loop looks whether a valve at null stays there, before it sends null again.
        """

    def driven(self) -> str:
        """Return what of the valve is not at null, over a new connection; empty if nothing is.

        Raises:
            DriverError: nobody answers.
        """
