"""The emulated flow meters on their serial line, a pseudo-terminal, which send flows unasked."""

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
"""Time in s between two samples of a meter."""

_NOISE_BYTES: Final = 12


class MeterPanel:
    """Three emulated flow meters on one serial line, which is unplugged at first.

    Args:
        path: symbolic link to the near end of the serial line.
        flows: returns the three flows in m^3/s; NaN means that the sensor has failed.
        record: takes note when the line is plugged in or unplugged.

    Attributes:
        silent: whether no meter sends anything.
        noisy: whether noise comes between the text lines of the meters.
        cutting: whether text lines lose their ends.
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
        """Plug the line in; nothing happens if it is plugged in already.

        Raises:
            LinkError: the line cannot be made at the path.
        """
        self._line.plug_in()
        self._record.note("meters_plugged_in", path=str(self._line.path))

    def unplug(self) -> None:
        """Unplug the line: a program that has it open loses it."""
        self._line.unplug()
        self._record.note("meters_unplugged")

    async def run(self) -> None:
        """Send the flows every 0.1 s, until the task is cancelled."""
        while True:
            self.send()
            await asyncio.sleep(PERIOD_S)

    def send(self) -> None:
        """Send the three flows once, unless the meters are silent; an unplugged line loses them."""
        if self.silent:
            return
        for meter, flow in enumerate(self._flows(), start=1):
            failed = isnan(flow) or meter in self.failed
            self._line.write(self._spoiled(meter_line(meter, 0.0 if failed else flow, failed)))

    def close(self) -> None:
        """Remove the line; repeated calls do no harm."""
        self._line.unplug()

    def _spoiled(self, line: bytes) -> bytes:
        if self.cutting:
            line = line[: self._noise.randrange(len(line))]
        return self._noise.randbytes(_NOISE_BYTES) + line if self.noisy else line
