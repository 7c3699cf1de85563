"""A driver's access to a CAN bus: which bus, what it sends, and what has come in."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

from rig.io.driver import DriverError
from rig.plant import Quantity as _Quantity

from .libraries import python_can as can

Clock = Callable[[], float]
"""Seconds, as `time.monotonic`."""

Interface = Literal["socketcan", "pcan", "slcan", "udp_multicast", "virtual"]

LOOK: Final = 0.01
"""s. How often whoever waits for a device looks at the clock when nothing comes in."""

_MOST_FRAMES: Final = 500
"""Frames taken in at once: a babbling node must not keep the field process from its other work."""

_REMEDIES: Final[Mapping[Interface, str]] = {
    "socketcan": "bring it up: ip link set {channel} up type can bitrate {bitrate}",
    "pcan": "check the adapter and its driver",
    "slcan": "check the adapter and the name of its port",
    "udp_multicast": "give a multicast address such as 239.74.163.2, and install msgpack",
    "virtual": "report this",
}


@dataclass(frozen=True, kw_only=True)
class CanOptions:
    """Which bus a driver is on; several may share one.

    Attributes:
        interface: what python-can calls it: socketcan on a rig, udp_multicast for an emulated one.
        channel: `can0`, a serial port, or a multicast address.
        port: of udp_multicast.
        bitrate: in bit/s, of pcan and slcan; that of socketcan is set by `ip link`.
        rate: how often the device is read and written.
        silence: after so long without what a device sends by itself, it is lost.
    """

    interface: Interface = "socketcan"
    channel: str = "can0"
    port: Annotated[int, _Quantity("", 1024, 65535, "", "unprivileged ports")] = 43113
    bitrate: Annotated[int, _Quantity("", 10_000, 1_000_000, "", "CiA 301, table 1")] = 500_000
    rate: Annotated[float, _Quantity("Hz", 1.0, 100.0, "", "")] = 20.0
    silence: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 0.5


class CanLink:
    """An open bus, or a part of one, for one driver.

    Args:
        driver: its name; errors begin with it.
        options: which bus.
        identifiers: of the frames wanted.
        extended: whether these have 29 bits.

    Raises:
        DriverError: there is no such bus.
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
        self.place = _place(options)
        self._identifiers = frozenset(identifiers)
        self._extended = extended
        self._bus = open_bus(driver, options)

    def send(self, identifier: int, data: bytes, *, extended: bool = False) -> None:
        """Send one frame; `extended`: with a 29-bit identifier.

        Raises:
            DriverError: the bus does not take it.
        """
        frame = can.Message(
            arbitration_id=identifier, data=data, is_extended_id=extended, check=True
        )
        try:
            self._bus.send(frame)
        except (can.CanError, OSError) as error:
            state = f"cannot send on {self.place}: {error}"
            raise DriverError(self._driver, state, "check cable and termination") from error

    def receive(self, wait: float = 0.0) -> list[can.Message]:
        """Return the frames wanted that have come in; with none there, wait up to so many seconds.

        What the bus cannot read is passed over: a device that nothing comes from is missed by
        whoever watches its heartbeat.
        """
        frames: list[can.Message] = []
        for _ in range(_MOST_FRAMES):
            try:
                frame = self._bus.recv(wait)
            except (can.CanError, OSError):
                continue
            finally:
                wait = 0.0
            if frame is None:
                break
            if self._is_wanted(frame):
                frames.append(frame)
        return frames

    def _is_wanted(self, frame: can.Message) -> bool:
        # Not by python-can's filters: where the kernel does not filter, recv(0) says None to a
        # frame that it drops, as if there were no more.
        return (
            frame.arbitration_id in self._identifiers
            and frame.is_extended_id == self._extended
            and not (frame.is_error_frame or frame.is_remote_frame)
        )

    def close(self) -> None:
        """Let go of the bus."""
        self._bus.shutdown()


def open_bus(driver: str, options: CanOptions) -> can.BusABC:
    """Return a bus opened by python-can.

    Args:
        driver: who opens it; the error begins with it.
        options: which bus.

    Raises:
        DriverError: there is no such bus.
    """
    particulars: dict[str, Any] = {}
    match options.interface:
        case "udp_multicast":
            # hop_limit 0: the frames of an emulated rig do not leave this machine.
            particulars = {"port": options.port, "hop_limit": 0}
        case "pcan" | "slcan":
            particulars = {"bitrate": options.bitrate}
    try:
        # ignore_config: the rig file says all, no ~/.canrc does.
        return can.Bus(
            ignore_config=True,
            interface=options.interface,
            channel=options.channel,
            **particulars,
        )
    except (can.CanError, OSError, ValueError, ImportError) as error:
        remedy = _REMEDIES[options.interface]
        action = remedy.format(channel=options.channel, bitrate=options.bitrate)
        raise DriverError(driver, f"cannot open {_place(options)}: {error}", action) from error


def _place(options: CanOptions) -> str:
    port = f":{options.port}" if options.interface == "udp_multicast" else ""
    return f"{options.interface} {options.channel}{port}"
