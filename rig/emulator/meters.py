"""The flow meters on their serial line: a pseudo-terminal that sends three flows by itself."""

import asyncio
import random
from collections.abc import Callable, Sequence
from math import isnan
from pathlib import Path
from typing import Final

from rig.io import meter_line

from .pseudo_terminal import PseudoTerminal
from .record import Record

PERIOD_S: Final = 0.1
"""Time between two samples of a meter."""

_NOISE_BYTES: Final = 12


class MeterPanel:
    """Three meters on one line.

    Args:
        path: link to the line's near end.
        flows: returns the flows in m^3/s, 3 numbers; NaN is a failed sensor.
        record: takes note of plugging.

    Attributes:
        silent: no meter says anything.
        noisy: noise on the line between the meters' lines.
        cutting: lines lose their ends.
        failed: numbers (1 to 3) of meters whose sensors have failed.
    """

    def __init__(self, path: Path, flows: Callable[[], Sequence[float]], record: Record) -> None:
        self.silent = self.noisy = self.cutting = False
        self.failed: set[int] = set()
        self._line = PseudoTerminal(path)
        self._flows = flows
        self._record = record
        self._noise = random.Random(0)

    def plug_in(self) -> None:
        """Plug the line in; harmless when it is.

        Raises:
            LinkError: there can be no such line.
        """
        self._line.plug_in()
        self._record.note("meters_plugged_in", path=str(self._line.path))

    def unplug(self) -> None:
        """Pull the plug: who has the line open loses it."""
        self._line.unplug()
        self._record.note("meters_unplugged")

    async def run(self) -> None:
        """Send the flows for ever."""
        while True:
            self.send()
            await asyncio.sleep(PERIOD_S)

    def send(self) -> None:
        """Send the three flows once."""
        if self.silent:
            return
        for meter, flow in enumerate(self._flows(), start=1):
            failed = isnan(flow) or meter in self.failed
            self._line.write(self._spoiled(meter_line(meter, 0.0 if failed else flow, failed)))

    def close(self) -> None:
        """Take the line away; harmless when repeated."""
        self._line.unplug()

    def _spoiled(self, line: bytes) -> bytes:
        if self.cutting:
            line = line[: self._noise.randrange(len(line))]
        return self._noise.randbytes(_NOISE_BYTES) + line if self.noisy else line
