"""The calibration of a transducer: what it indicated at known values, and how long that holds.

A laboratory compares a transducer with a reference and writes a certificate. What is indicated
differs from the reference by an error, and the correction is this error with the other sign. A
`TransducerCalibration` has nothing to do with the needle tables of `rig calibrate valves`, which
say what a valve passes.
"""

import datetime
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, timedelta
from typing import Final, NamedTuple

RENEW: Final = "name the file of a calibration that holds today in the rig file"
"""The remedy for a calibration that does not hold."""


class CalibrationPoint(NamedTuple):
    """One point of a calibration, in the SI unit of the channel."""

    reference: float
    """What the reference of the laboratory read: the true value."""
    indicated: float
    """What the transducer indicated at that value."""

    @property
    def correction(self) -> float:
        """What must be added to the indicated value to get the reference value."""
        return self.reference - self.indicated


@dataclass(frozen=True)
class TransducerCalibration:
    """A calibration of the transducer that a channel reads, all values in the channel's SI unit.

    Attributes:
        channel: name of the channel, such as `pressure_1_Pa`.
        transducer: serial number or label of the transducer.
        date: day of the calibration, from which on it holds.
        valid_until: last day on which it holds.
        points: two points or more, with both values strictly increasing.
        laboratory: who calibrated it; empty if not given.
        certificate: number of the certificate; empty if not given.
        uncertainty: expanded uncertainty of the points, as the certificate states it; None if it is
            not given.
    """

    channel: str
    transducer: str
    date: datetime.date
    valid_until: datetime.date
    points: tuple[CalibrationPoint, ...]
    laboratory: str = ""
    certificate: str = ""
    uncertainty: float | None = None

    @property
    def largest_correction(self) -> float:
        """The correction of greatest size among those of the points, with its sign."""
        return max((point.correction for point in self.points), key=abs)

    def corrected(self, value: float) -> float:
        """Return the reference value that belongs to an indicated value; see `corrected`."""
        indicated = [point.indicated for point in self.points]
        corrections = [point.correction for point in self.points]
        return corrected(value, 0, len(self.points), indicated, corrections)

    def doubt(self, day: datetime.date) -> str:
        """Return why the calibration does not hold on a day, as a phrase; empty if it holds."""
        if day > self.valid_until:
            return f"expired on {self.valid_until}"
        return f"is not valid before {self.date}" if day < self.date else ""

    def __str__(self) -> str:
        """Return channel and transducer, by which a message names the calibration."""
        return f"calibration of {self.channel} (transducer {self.transducer})"


def corrected(
    value: float, first: int, end: int, indicated: Sequence[float], corrections: Sequence[float]
) -> float:
    """Return the reference value for an indicated one; NaN stays NaN.

    The correction is linear between two points. Beyond the first and the last point it is that of
    this point: what lies beyond was not measured, and to go on with the last slope would enlarge an
    error there. So the corrected value rises with the indicated one everywhere. `rig.io.correction`
    compiles this function for the loop.

    Args:
        value: the indicated value.
        first: index of the first point.
        end: index one past that of the last point.
        indicated: indicated values of the points, increasing.
        corrections: corrections at the points.
    """
    if not value > indicated[first]:
        return value + corrections[first]
    if value >= indicated[end - 1]:
        return value + corrections[end - 1]
    low, high = first, end - 1
    while high - low > 1:
        middle = (low + high) // 2
        if indicated[middle] <= value:
            low = middle
        else:
            high = middle
    share = (value - indicated[low]) / (indicated[high] - indicated[low])
    return value + (corrections[low] + share * (corrections[high] - corrections[low]))


def today() -> datetime.date:
    """Return the day by this machine's clock and time zone."""
    return datetime.datetime.now(UTC).astimezone().date()


def calibration_doubts(
    calibrations: Iterable[TransducerCalibration],
    day: datetime.date,
    ahead: timedelta = timedelta(0),
) -> Iterator[str]:
    """Yield a sentence for each calibration that does not hold on a day, or soon will not.

    Args:
        calibrations: the calibrations of a rig.
        day: the day on which they are used.
        ahead: a calibration that expires within this time is named too.
    """
    for each in calibrations:
        doubt, left = each.doubt(day), each.valid_until - day
        if doubt:
            yield f"the {each} {doubt}; {RENEW}"
        elif left < ahead:
            days = {0: "today", 1: "in 1 day"}.get(left.days, f"in {left.days} days")
            yield f"the {each} expires {days}: {each.valid_until} is the last day on which it holds"
