"""Serves emulated devices on a CAN bus, in the event loop of the emulator."""

import asyncio
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from rig.io import python_can as can

Send = Callable[[can.Message], None]
"""Puts a frame on the bus."""

Note = Callable[..., None]
"""Takes note of an event by its name and details, as `rig.emulator.record.Record.note` does."""

_PERIOD: Final = 0.005
"""Time in s between two cycles of the nodes."""


class Node(Protocol):
    """An emulated device on a bus."""

    def receive(self, frame: can.Message) -> None:
        """Handle a frame from the bus."""

    def cycle(self, now: float) -> None:
        """Do what is due at the time `now` in s."""


async def serve(bus: can.BusABC, nodes: Iterable[Node]) -> None:
    """Serve nodes on one bus until the task is cancelled; the bus stays open."""
    loop, nodes = asyncio.get_running_loop(), tuple(nodes)
    notifier = can.Notifier(bus, [node.receive for node in nodes], timeout=0.05, loop=loop)
    try:
        while True:
            for node in nodes:
                node.cycle(loop.time())
            await asyncio.sleep(_PERIOD)
    finally:
        notifier.stop()
