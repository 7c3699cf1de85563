r"""The flow meters' line protocol: ASCII, one line a meter and sample, unsolicited.

`$FM,<meter>,<flow>,<status>*<checksum>\r\n`: meter 1, 2 or 3; flow in L/min with 3 decimals; status
in hexadecimal, bit 0 a sensor fault; checksum the exclusive or of all characters between `$` and
`*`, as 2 hexadecimal digits (as in NMEA 0183).
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
"""Bytes up to the line feed that any valid line has room in."""


class MeterLine(NamedTuple):
    """What one line says: number of the meter, flow in m^3/s, NaN if its sensor has failed."""

    meter: int
    flow: float


@dataclass
class LineCounts:
    """What has come over the line so far.

    Attributes:
        valid: lines understood.
        checksum_errors: lines with a wrong checksum.
        malformed: anything else that ended in a line feed.
    """

    valid: int = 0
    checksum_errors: int = 0
    malformed: int = 0


class MeterLineParser:
    """Finds the valid lines in a stream of bytes, however it is cut and whatever else is in it.

    Attributes:
        counts: what has come so far.
    """

    def __init__(self) -> None:
        self.counts = LineCounts()
        self._begun = b""

    def feed(self, data: bytes) -> list[MeterLine]:
        """Return the lines that end in these bytes."""
        *ended, begun = (self._begun + data).split(b"\n")
        # No valid line is longer, so whatever stands before is none.
        self._begun = begun[-_LONGEST:]
        found = (self._parse(line) for line in ended)
        return [line for line in found if line is not None]

    def _parse(self, line: bytes) -> MeterLine | None:
        # A line that was cut, or noise, may stand before it.
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
    """Return the line by which a meter sends a flow in m^3/s."""
    status = _SENSOR_FAULT if failed else 0
    body = f"FM,{meter},{flow / LITRE_PER_MINUTE:.3f},{status:02X}".encode("ascii")
    return b"$%s*%02X\r\n" % (body, _checksum(body))


def _checksum(body: bytes) -> int:
    return reduce(xor, body)
