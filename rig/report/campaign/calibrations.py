"""The table of a campaign's page that names the calibrations of the rig's transducers."""

from dataclasses import dataclass

from rig.configuration import show
from rig.runner.outcomes import CampaignOutcome


@dataclass(frozen=True)
class CalibrationRow:
    """A row of the table, all of it text.

    Attributes:
        channel: name of the channel.
        transducer: serial number or label of the transducer; empty without calibration.
        date: day of the calibration; empty without one.
        valid_until: last day on which it holds; empty without one.
        correction: its largest correction, with its sign; empty without one.
        remark: whether it held during the campaign, or that there is none.
        doubtful: whether the calibration did not hold.
    """

    channel: str
    transducer: str
    date: str
    valid_until: str
    correction: str
    remark: str
    doubtful: bool = False


def calibration_rows(outcome: CampaignOutcome) -> tuple[CalibrationRow, ...]:
    """Return the rows of the table: all calibrations, then the channels that have none.

    There are no rows if no channel has a calibration.
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
        for each in outcome.calibrations
    ]
    rows += [
        CalibrationRow(channel, "", "", "", "", "no calibration")
        for channel in outcome.uncalibrated
    ]
    return tuple(rows)
