"""Which calibrations of transducers a campaign used, for its results, its report and recordings."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date
from typing import Any

from rig.configuration import Rig, plain
from rig.recording import unit_of


@dataclass(frozen=True)
class CalibrationUsed:
    """A calibration by which the readings of a campaign were corrected.

    Attributes:
        channel: name of the channel.
        transducer: serial number or label of the transducer.
        date: day of the calibration, ISO 8601.
        valid_until: last day on which it holds, ISO 8601.
        largest_correction: the correction of greatest size among those of its points, with its
            sign, in `unit`.
        unit: SI unit of the channel.
        doubt: why it did not hold during the campaign, such as `expired on 2026-05-01`; empty if it
            held.
    """

    channel: str
    transducer: str
    date: str
    valid_until: str
    largest_correction: float
    unit: str
    doubt: str = ""


def calibrations_used(rig: Rig, days: Iterable[date]) -> tuple[CalibrationUsed, ...]:
    """Return the calibrations of a rig that a campaign used on some days, in the rig's order."""
    days = tuple(days)
    return tuple(
        CalibrationUsed(
            each.channel,
            each.transducer,
            str(each.date),
            str(each.valid_until),
            each.largest_correction,
            unit_of(each.channel),
            next(filter(None, map(each.doubt, days)), ""),
        )
        for each in rig.calibrations
    )


def calibrations_applied(rig: Rig) -> dict[str, Any]:
    """Return what a recording's metadata say of the calibrations in it; {} if the rig has none.

    `calibrations` are those by which the readings were corrected before they were recorded, with
    their points, so that the correction can be undone. A replay takes the readings as they are.
    `uncalibrated` are the measured channels that were not corrected.
    """
    if not rig.calibrations:
        return {}
    return {
        "calibrations": [
            {
                **plain(each),
                "largest_correction": each.largest_correction,
                "unit": unit_of(each.channel),
            }
            for each in rig.calibrations
        ],
        "uncalibrated": list(rig.uncalibrated),
    }
