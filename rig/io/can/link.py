"""A driver's access to a CAN bus: its options, and the sending and receiving of frames."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from rig.io.driver import DriverError
from rig.plant import Quantity as _Quantity

from .frames import FrameReader
from .libraries import python_can as can

Clock = Callable[[], float]
"""Returns the time in s, as `time.monotonic` does."""

Interface = Literal["socketcan", "pcan", "slcan", "udp_multicast", "virtual"]

LOOK: Final = 0.01
"""Time in s after which code that waits for a frame looks at the clock again if none comes."""

_REMEDIES: Final[Mapping[Interface, str]] = {
    "socketcan": "bring it up: ip link set {channel} up type can bitrate {bitrate}",
    "pcan": "check the adapter and its driver",
    "slcan": "check the adapter and the name of its port",
    "udp_multicast": "give a multicast address such as 239.74.163.2, and install msgpack",
    "virtual": "report this",
}


@dataclass(frozen=True, kw_only=True)
class CanOptions:
    """The CAN bus of a driver and how it is used; several drivers may share a bus.

    Attributes:
        interface: python-can's name of the interface: socketcan on a rig, udp_multicast for an
            emulated one.
        channel: `can0`, a serial port, or a multicast address.
        port: UDP port, for udp_multicast.
        bitrate: in bit/s, for pcan and slcan; for socketcan `ip link` sets it.
        rate: how often the device is read and written.
        silence: time without the messages that a device sends by itself after which it counts as
            lost.
    """

    interface: Interface = "socketcan"
    channel: str = "can0"
    port: Annotated[int, _Quantity("", 1024, 65535, "", "unprivileged ports")] = 43113
    bitrate: Annotated[int, _Quantity("", 10_000, 1_000_000, "", "CiA 301, table 1")] = 500_000
    rate: Annotated[float, _Quantity("Hz", 1.0, 100.0, "", "")] = 20.0
    silence: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 0.5

    @property
    def bus(self) -> str:
        """Name of the bus in messages."""
        port = f":{self.port}" if self.interface == "udp_multicast" else ""
        return f"{self.interface} {self.channel}{port}"


class CanLink:
    """An open bus of which one driver receives the frames that it wants.

    Args:
        driver: name of the driver; errors begin with it.
        options: says which bus it is.
        identifiers: identifiers of the wanted frames.
        extended: whether these identifiers have 29 bits; otherwise they have 11.

    Raises:
        DriverError: the bus cannot be opened.
    """

    def __init__(
        self,
        driver: str,
        options: CanOptions,
        identifiers: Iterable[int],
        *,
        extended: bool = False,
    ) -> None:
        self._driver = driver
        self._place = options.bus
        self._identifiers = frozenset(identifiers)
        self._extended = extended
        self._bus = open_bus(driver, options)
        self._frames = FrameReader(self._bus)

    def send(
        self,
        identifier: int,
        data: bytes,
        *,
        extended: bool = False,
        wanted: Callable[[], bool] | None = None,
    ) -> None:
        """Send one frame, with a 29-bit identifier if `extended`, else with one of 11 bits.

        If `wanted` is given, it is asked when the frame is ready, right before the bus gets it; if
        it returns False, nothing is sent.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        frame = can.Message(
            arbitration_id=identifier, data=data, is_extended_id=extended, check=True
        )
        if wanted is not None and not wanted():
            return
        try:
            self._bus.send(frame)
        except (can.CanError, OSError) as error:
            state = f"cannot send on {self._place}: {error}"
            raise DriverError(self._driver, state, "check cable and termination") from error

    def receive(self, wait: float = 0.0) -> list[can.Message]:
        """Return the wanted frames among those that have come in, 500 at most.

        If no frame at all has come in, it waits up to `wait` seconds for the first one. What is no
        frame is passed over, and so are errors of reading the bus, since the check of a device's
        heartbeat notices when nothing comes from it any more.
        """
        return [frame for frame in self._frames.take(wait) if self._is_wanted(frame)]

    def _is_wanted(self, frame: can.Message) -> bool:
        # python-can's filters are not used: where the kernel does not filter, recv(0) returns None
        # for a frame that it drops, as if no more frames were there.
        return frame.arbitration_id in self._identifiers and frame.is_extended_id == self._extended

    def close(self) -> None:
        """Close the connection to the bus."""
        self._bus.shutdown()


def open_bus(driver: str, options: CanOptions) -> can.BusABC:
    """Return a bus opened by python-can.

    Args:
        driver: name of the part that opens the bus; the error begins with it.
        options: says which bus it is.

    Raises:
        DriverError: the bus cannot be opened.
    """
    try:
        if options.interface == "udp_multicast":
            from .multicast import MulticastBus

            # hop_limit 0: the frames of an emulated rig do not leave this machine.
            return MulticastBus(options.channel, options.port, hop_limit=0)
        speed: dict[str, Any] = (
            {"bitrate": options.bitrate} if options.interface in ("pcan", "slcan") else {}
        )
        # ignore_config: the rig file alone configures the bus, no ~/.canrc does.
        return can.Bus(
            ignore_config=True, interface=options.interface, channel=options.channel, **speed
        )
    except (can.CanError, OSError, ValueError, ImportError) as error:
        remedy = _REMEDIES[options.interface]
        action = remedy.format(channel=options.channel, bitrate=options.bitrate)
        raise DriverError(driver, f"cannot open {options.bus}: {error}", action) from error
