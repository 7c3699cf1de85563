"""Serves Modbus RTU on a pseudo-terminal, since pymodbus itself opens serial ports only by name."""

import asyncio

from pymodbus.server.requesthandler import ServerRequestHandler

from rig.emulator.pseudo_terminal import PseudoTerminal


class RtuLine(asyncio.Transport):
    """The far end of a pseudo-terminal, which pymodbus uses as a serial port.

    Args:
        line: the pseudo-terminal, which must be plugged in.
        handler: answers the requests that come over it.
    """

    def __init__(self, line: PseudoTerminal, handler: ServerRequestHandler) -> None:
        super().__init__()
        self._line = line
        self._loop = asyncio.get_running_loop()
        self._loop.add_reader(line.fileno(), lambda: handler.data_received(line.read()))
        handler.connection_made(self)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Send a reply."""
        self._line.write(bytes(data))

    def close(self) -> None:
        """Unplug the line."""
        self._loop.remove_reader(self._line.fileno())
        self._line.unplug()
