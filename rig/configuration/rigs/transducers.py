"""Transducer files: one calibration of one transducer each, as a laboratory's certificate has it.

They are no files of `rig calibrate valves` (`calibration_file.py`), which hold needle tables.
"""

import datetime
import re
from calendar import monthrange
from collections.abc import Iterator
from datetime import timedelta
from itertools import pairwise
from typing import Annotated, Any, Final

from pydantic import Field as SchemaField, create_model

from rig.channels import CHANNELS, Kind
from rig.configuration.reading import (
    Field,
    Located,
    Physical,
    QuantityError,
    Schema,
    Under,
    elements_of,
    quantity_in,
    read_mapping,
    show,
    suggestion,
)
from rig.io import CalibrationPoint, TransducerCalibration
from rig.recording import unit_of

CALIBRATED: Final = tuple(
    channel.name
    for channel in CHANNELS
    if channel.kind in (Kind.READING, Kind.CARRIED, Kind.SLOW) and unit_of(channel.name)
)
"""Channels whose transducer may have a calibration: all measured quantities that have a unit."""

MOST_SHARE: Final = 0.25
"""Largest correction, as a part of the calibrated span, and from point to point as a part of the
step. The effects of the plant let the span of a transducer be wrong by 20 %; a larger correction is
a slip of unit, decimal point or column, and no transducer to measure with."""

SOON: Final = timedelta(days=30)
"""Time before a calibration's end from which on `rig check` warns: a laboratory takes weeks."""

_PERIOD: Final = re.compile(r"(\d{1,5}) (day|month|year)s?")


class _Period(Field):
    """The annotation of a period of the calendar, `12 months`; `parse` returns number and unit."""

    def parse(self, raw: object) -> tuple[int, str]:
        match = _PERIOD.fullmatch(str(raw).strip())
        if match is None or int(match[1]) == 0:
            raise QuantityError("is no period", "write days, months or years, such as `12 months`")
        return int(match[1]), match[2]

    def json_schema(self) -> dict[str, Any]:
        return {"type": "string", "pattern": _PERIOD.pattern}


class _OfChannel(Field):
    """The annotation of a quantity whose unit is that of the file's channel.

    `parse` returns it as it is written, since only the whole file tells the channel.
    """

    def parse(self, raw: object) -> object:
        return raw

    def json_schema(self) -> dict[str, Any]:
        return {"type": "string", "description": "a quantity with a unit of the channel"}


class TransducerPointFile(Schema):
    """Keys of a point of a calibration, each a quantity with its unit."""

    reference: Annotated[Any, _OfChannel()]
    indicated: Annotated[Any, _OfChannel()]


class TransducerFile(Schema):
    """Keys of a transducer file: a calibration of the transducer that a channel reads."""

    channel: Annotated[str, SchemaField(json_schema_extra={"enum": list(CALIBRATED)})]
    transducer: str
    date: datetime.date
    valid_until: datetime.date | None = None
    valid_for: Annotated[tuple[int, str] | None, _Period()] = None
    laboratory: str = ""
    certificate: str = ""
    uncertainty: Annotated[Any, _OfChannel()] = None
    points: Annotated[Any, Under(lambda: (TransducerPointFile,), many=True)]


_HINTS: Final = {
    "needles": "a file of `rig calibrate valves` belongs under a bypass: "
    "`needle: {calibration: ...}`"
}


def read_transducer(root: Located) -> TransducerCalibration | None:
    """Return the calibration that a transducer file describes; None if it cannot be used.

    Problems are recorded.
    """
    problems = root.sources.problems
    before = problems.reported
    file = read_mapping(TransducerFile, root, _HINTS)
    channel = root.get("channel")
    if channel is None or channel.value not in CALIBRATED:
        if channel is not None:
            remedy = suggestion(str(channel.value), CALIBRATED, "channels of transducers")
            channel.refuse("is no channel of a transducer", remedy)
        return None
    unit = unit_of(channel.value)
    points = _read_points(root, unit)
    uncertainty = root.get("uncertainty")
    known = None
    if uncertainty is not None:
        quantity = Physical(unit, 0.0)
        known = quantity_in(uncertainty, lambda: quantity.parse(uncertainty.value))
    valid_until = _valid_until(root, file) if file is not None else None
    if file is None or valid_until is None or problems.reported > before:
        return None
    return TransducerCalibration(
        channel=file.channel,
        transducer=file.transducer,
        date=file.date,
        valid_until=valid_until,
        points=points,
        laboratory=file.laboratory,
        certificate=file.certificate,
        uncertainty=known,
    )


def _valid_until(root: Located, file: TransducerFile) -> datetime.date | None:
    """Return the last day on which a calibration holds; None, with a problem, if it is not said."""
    ends = [root.value[key] for key in ("valid_until", "valid_for") if key in root.value]
    if any(root.sources.problems.has_at(end.place, end.name) for end in ends):
        return None
    if (file.valid_until is None) == (file.valid_for is None):
        if root.get("valid_until") is None or root.get("valid_for") is None:
            remedy = "add `valid_until: 2027-03-31` or `valid_for: 12 months`"
            root.refuse("does not say how long it holds", remedy, "", name="calibration")
        else:
            root.refuse("is given beside valid_until", "keep one of them", key="valid_for")
        return None
    try:
        until = file.valid_until or _after(file.date, *(file.valid_for or (0, "day")))
    except (OverflowError, ValueError):
        root.refuse("ends after the year 9999", "write a shorter one", key="valid_for")
        return None
    if until < file.date:
        limit = f"is before the day of the calibration, {file.date}"
        root.refuse(limit, "correct one of them", key="valid_until")
        return None
    return until


def _after(day: datetime.date, count: int, unit: str) -> datetime.date:
    """Return the day that is so many days, months or years after another day.

    Where the month has no such day, the result is the last day of the month.

    Raises:
        OverflowError, ValueError: it is after the year 9999.
    """
    if unit == "day":
        return day + timedelta(days=count)
    months = 12 * day.year + day.month - 1 + count * (12 if unit == "year" else 1)
    year, month = months // 12, months % 12 + 1
    if year > datetime.MAXYEAR:
        raise OverflowError
    return day.replace(year=year, month=month, day=min(day.day, monthrange(year, month)[1]))


def _read_points(root: Located, unit: str) -> tuple[CalibrationPoint, ...]:
    """Return the points of a calibration, by rising reference; () if they are unusable.

    Problems are recorded. They may stand in any order in the file.
    """
    section = root.get("points")
    if section is None:
        return ()
    keys: dict[str, Any] = dict.fromkeys(
        TransducerPointFile.model_fields, (Annotated[float, Physical(unit)], ...)
    )
    schema = create_model("TransducerPointFile", __base__=Schema, **keys)
    example = "write a list: - {reference: 5 MPa, indicated: 5.02 MPa}"
    problems = root.sources.problems
    before = problems.reported
    found = []
    for element in elements_of(section, example):
        file = read_mapping(schema, element)
        if file is not None:
            values = file.model_dump()
            found.append((CalibrationPoint(values["reference"], values["indicated"]), element))
    if problems.reported > before:
        return ()
    if len(found) < 2:
        remedy = "give two or more, at the ends of what is measured and between"
        section.refuse("are too few for a line", remedy, str(len(found)))
        return ()
    found.sort(key=lambda pair: pair[0].reference)
    _check_points(found, unit)
    return tuple(point for point, _ in found)


def _check_points(found: list[tuple[CalibrationPoint, Located]], unit: str) -> None:
    """Record a problem for each point that repeats a reference or has an incredible correction."""
    span = found[-1][0].reference - found[0][0].reference
    share = f"{100 * MOST_SHARE:g} %"
    if span > 0.0:
        for point, element in found:
            if abs(point.correction) > MOST_SHARE * span:
                limit = (
                    f"is {show(abs(point.correction), unit)} from the reference, more than {share} "
                    f"of the calibrated span of {show(span, unit)}"
                )
                remedy = "look for a slip of unit or column; else mend or rescale the transducer"
                element.refuse(limit, remedy, key="indicated")
                return
    for (below, _), (point, element) in pairwise(found):
        step = point.reference - below.reference
        if step == 0.0:
            remedy = "give one point for each, such as the mean of rising and falling"
            element.refuse("is given twice", remedy, key="reference")
        elif abs(point.correction - below.correction) > MOST_SHARE * step:
            limit = (
                f"changes the correction by more than {share} of the step from the point at "
                f"{show(below.reference, unit)}"
            )
            element.refuse(limit, "correct it, or leave out one of the two points", key="indicated")


def transducer_lines(calibration: TransducerCalibration) -> Iterator[str]:
    """Yield the lines in which `rig check` describes a transducer file."""
    first, last = calibration.points[0], calibration.points[-1]
    unit = unit_of(calibration.channel)
    yield (
        f"  {calibration.channel}, transducer {calibration.transducer}: calibrated on "
        f"{calibration.date}, holds until {calibration.valid_until}"
    )
    yield (
        f"  {len(calibration.points)} points from {show(first.reference, unit)} to "
        f"{show(last.reference, unit)}, largest correction "
        f"{show(calibration.largest_correction, unit)}"
    )
    given = [text for text in (calibration.laboratory, calibration.certificate) if text]
    if calibration.uncertainty is not None:
        given.append(f"expanded uncertainty {show(calibration.uncertainty, unit)}")
    if given:
        yield f"  {', '.join(given)}"
