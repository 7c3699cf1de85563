"""Serves emulated devices on a CAN bus, in the event loop of the emulator."""

import asyncio
from collections.abc import Callable, Iterable
from math import inf
from typing import Final, Protocol

from rig.io import FrameReader, python_can as can
from rig.surviving import failure

Send = Callable[[can.Message], None]
"""Puts a frame on the bus."""

Note = Callable[..., None]
"""Takes note of an event by its name and details, as `rig.emulator.record.Record.note` does."""

_PERIOD: Final = 0.005
"""Time in s between two cycles of the nodes."""
_NOTE_S: Final = 1.0
"""Time in s between two notes of what was passed over, so that a flood does not fill the record."""


class Node(Protocol):
    """An emulated device on a bus."""

    def receive(self, frame: can.Message) -> None:
        """Handle a frame from the bus."""

    def cycle(self, now: float) -> None:
        """Do what is due at the time `now` in s."""


async def serve(bus: can.BusABC, name: str, nodes: Iterable[Node], note: Note) -> None:
    """Serve nodes on one bus until the task is cancelled; the bus stays open.

    What is no frame is passed over, and so is a frame that a node cannot take.

    Args:
        bus: the bus.
        name: name of the bus in the record.
        nodes: the nodes on it.
        note: takes note of what was passed over, once a second at most.
    """
    loop = asyncio.get_running_loop()
    traffic = _Traffic(bus, name, tuple(nodes), note)
    watched = _descriptor(bus)
    if watched is not None:
        loop.add_reader(watched, traffic.take)
    try:
        while True:
            if watched is None:
                traffic.take()
            traffic.cycle(loop.time())
            await asyncio.sleep(_PERIOD)
    finally:
        if watched is not None:
            loop.remove_reader(watched)


def _descriptor(bus: can.BusABC) -> int | None:
    """Return the descriptor that is readable when a frame comes; None if the bus has none."""
    try:
        return bus.fileno()
    except NotImplementedError:
        return None


class _Traffic:
    """Passes the frames of a bus on to its nodes, and counts what it passes over."""

    def __init__(self, bus: can.BusABC, name: str, nodes: tuple[Node, ...], note: Note) -> None:
        self._reader = FrameReader(bus)
        self._name = name
        self._nodes = nodes
        self._note = note
        self._refused = self._told = 0
        self._why = ""
        self._told_at = -inf

    def take(self) -> None:
        """Pass on the frames that have come in."""
        for frame in self._reader.take():
            for node in self._nodes:
                try:
                    node.receive(frame)
                except Exception as error:  # no frame ends the service of the others
                    self._refused += 1
                    self._why = failure(error)

    def cycle(self, now: float) -> None:
        """Let the nodes do what is due at `now`, s, and note what was passed over meanwhile."""
        for node in self._nodes:
            node.cycle(now)
        passed = self._reader.unreadable + self._refused
        if passed > self._told and now - self._told_at >= _NOTE_S:
            details = {"why": self._why} if self._why else {}
            self._note("can_unreadable", bus=self._name, new=passed - self._told, **details)
            self._told, self._told_at, self._why = passed, now, ""
