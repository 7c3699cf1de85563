"""Which calibrations of transducers a campaign used, for its results, its report and recordings.

What recordings name is read again for the pages of what is found in them.
"""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, date, datetime
from typing import Any, Final

from rig.configuration import Rig, plain
from rig.recording import Recording, unit_of

_TEXTS: Final = ("channel", "transducer", "date", "valid_until")


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


def calibrations_recorded(
    recordings: Iterable[Recording],
) -> tuple[tuple[CalibrationUsed, ...], tuple[str, ...]]:
    """Return the calibrations that recordings name, each once, and the channels without one.

    Entries of the metadata that cannot be read are left out, as files of other programs may have
    metadata of the same name. A calibration is in doubt if one of the recordings was made on a day
    on which it did not hold.
    """
    used: dict[tuple[str, ...], CalibrationUsed] = {}
    without: dict[str, None] = {}
    for recording in recordings:
        named = recording.metadata
        start_ns = named.get("start_ns")
        day = ""
        if isinstance(start_ns, int) and start_ns > 0:
            day = str(datetime.fromtimestamp(start_ns / 1e9, UTC).date())
        for entry in _entries(named.get("calibrations")):
            with suppress(KeyError, TypeError, ValueError):
                texts = tuple(str(entry[key]) for key in _TEXTS)
                channel, transducer, since, until = texts
                doubt = f"recorded on {day}, outside its validity" if day else ""
                if since <= day <= until:
                    doubt = ""
                correction = float(entry["largest_correction"])
                found = CalibrationUsed(
                    channel, transducer, since, until, correction, unit_of(channel), doubt
                )
                if texts not in used or doubt:
                    used[texts] = found
        without |= dict.fromkeys(map(str, _entries(named.get("uncalibrated"))))
    return tuple(used.values()), tuple(without)


def _entries(named: object) -> list[Any]:
    """Return the entries of a list in metadata; [] if it is none."""
    return named if isinstance(named, list) else []
