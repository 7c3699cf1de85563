"""The table of a page that names the calibrations of the rig's transducers."""

from collections.abc import Iterable
from dataclasses import dataclass

from rig.configuration import show
from rig.runner.outcomes import CalibrationUsed


@dataclass(frozen=True)
class CalibrationRow:
    """A row of the table, all of it text.

    Attributes:
        channel: name of the channel.
        transducer: serial number or label of the transducer; empty without calibration.
        date: day of the calibration; empty without one.
        valid_until: last day on which it holds; empty without one.
        correction: its largest correction, with its sign; empty without one.
        remark: whether it held when it was used, or that there is none.
        doubtful: whether the calibration did not hold.
    """

    channel: str
    transducer: str
    date: str
    valid_until: str
    correction: str
    remark: str
    doubtful: bool = False


def calibration_rows(
    used: Iterable[CalibrationUsed], uncalibrated: Iterable[str]
) -> tuple[CalibrationRow, ...]:
    """Return the rows of the table: all calibrations, then the channels that have none.

    There are no rows if no channel has a calibration.

    Args:
        used: the calibrations by which readings were corrected.
        uncalibrated: names of the measured channels that have none.
    """
    rows = [
        CalibrationRow(
            each.channel,
            each.transducer,
            each.date,
            each.valid_until,
            show(each.largest_correction, each.unit),
            each.doubt or "holds",
            bool(each.doubt),
        )
        for each in used
    ]
    if not rows:
        return ()
    without = (CalibrationRow(name, "", "", "", "", "no calibration") for name in uncalibrated)
    return (*rows, *without)
