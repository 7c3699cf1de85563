r"""The flow meters' line protocol: a meter sends one ASCII line for each sample, without request.

A line is `$FM,<meter>,<flow>,<status>*<checksum>\r\n`. The meter is 1, 2 or 3. The flow is in L/min
with 3 decimals. The status is hexadecimal; its bit 0 means a sensor fault. The checksum is the
exclusive or of all characters between `$` and `*`, as 2 hexadecimal digits (as in NMEA 0183).
"""

import re
from dataclasses import dataclass
from functools import reduce
from math import nan
from operator import xor
from typing import Final, NamedTuple

from rig.plant import LITRE_PER_MINUTE

_SENSOR_FAULT: Final = 1
_LINE: Final = re.compile(
    rb"\$(?P<body>FM,(?P<meter>[123]),(?P<flow>-?\d{1,6}\.\d{3}),(?P<status>[0-9A-F]{1,4}))"
    rb"\*(?P<checksum>[0-9A-F]{2})\r"
)
_LONGEST: Final = 32
"""Number of bytes before the line feed that no valid line exceeds."""


class MeterLine(NamedTuple):
    """One line as values: number of the meter, and flow in m^3/s, NaN if its sensor has failed."""

    meter: int
    flow: float


@dataclass
class LineCounts:
    """Counts of the text lines that have come so far.

    Attributes:
        valid: number of valid lines.
        checksum_errors: number of lines with a wrong checksum.
        malformed: number of other texts that ended in a line feed.
    """

    valid: int = 0
    checksum_errors: int = 0
    malformed: int = 0


class MeterLineParser:
    """Finds the valid lines in a stream of bytes, however it is cut and whatever else is in it.

    Attributes:
        counts: counts of the lines so far.
    """

    def __init__(self) -> None:
        self.counts = LineCounts()
        self._begun = b""

    def feed(self, data: bytes) -> list[MeterLine]:
        """Return the valid lines that end in these bytes, in order; the rest is kept for later.

        Lines that are not valid are only counted.
        """
        *ended, begun = (self._begun + data).split(b"\n")
        # No valid line is longer than this, so that earlier bytes can belong to none.
        self._begun = begun[-_LONGEST:]
        return [line for line in map(self._parse, ended) if line is not None]

    def _parse(self, line: bytes) -> MeterLine | None:
        # Noise, or a part of another line, may precede the valid line.
        match = _LINE.fullmatch(line, max(line.rfind(b"$"), 0))
        if match is None:
            self.counts.malformed += 1
            return None
        if int(match["checksum"], 16) != _checksum(match["body"]):
            self.counts.checksum_errors += 1
            return None
        self.counts.valid += 1
        failed = int(match["status"], 16) & _SENSOR_FAULT
        flow = nan if failed else float(match["flow"]) * LITRE_PER_MINUTE
        return MeterLine(int(match["meter"]), flow)


def meter_line(meter: int, flow: float, failed: bool = False) -> bytes:
    """Return the line by which meter 1, 2 or 3 sends a flow in m^3/s, or a failed sensor."""
    status = _SENSOR_FAULT if failed else 0
    body = f"FM,{meter},{flow / LITRE_PER_MINUTE:.3f},{status:02X}".encode("ascii")
    return b"$%s*%02X\r\n" % (body, _checksum(body))


def _checksum(body: bytes) -> int:
    return reduce(xor, body)
