"""What a driver is: the one protocol to hardware, and the error that all drivers raise.

Third parties add a driver by an entry point of the group `hydraulic_rig.drivers` that names its
class; `rig.io.conformance` is the suite that it should pass.
"""

from collections.abc import Mapping
from typing import Any, ClassVar, Literal, Protocol, runtime_checkable


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
    """A device of the rig. Nothing moves before the first `write`.

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
