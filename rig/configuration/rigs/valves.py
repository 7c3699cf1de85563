"""The valves that make a rig's faults: bypasses for leaks, and one valve in the return line."""

import datetime
from dataclasses import dataclass
from typing import Annotated, Any, Final

from control import RequestError
from faults import FAULT_KINDS, BypassValve, NeedleCharacteristic, Verdict
from rig.configuration.reading import (
    Field,
    Located,
    Physical,
    QuantityError,
    Schema,
    Under,
    read_mapping,
    suggestion,
)

from .calibration_file import NeedleReference, find_needle

BYPASS_KINDS: Final = tuple(str(kind) for kind in FAULT_KINDS if kind != Verdict.RETURN_BLOCKAGE)

# These limits are far beyond any real valve; they only catch slips of unit and decimal point.
LEAKAGE: Final = Physical("m^3/(s Pa^0.5)", 0.0, 1e-6, 1e-8)
RESISTANCE: Final = Physical("Pa/(m^3/s)^2", 1e9, 1e14, 1e13)
TRAVEL: Final = Physical("s", 0.0, 60.0, 0.5)


@dataclass(frozen=True)
class ReturnValve:
    """A valve in the return line that shuts partly, as if a filter were clogged.

    Attributes:
        name: name of the valve in messages.
        travel_s: time in s that it takes from open to shut.
        maximum: greatest resistance in Pa/(m^3/s)^2 (turbulent, dp = R q^2).
    """

    name: str
    travel_s: float
    maximum: float


class BypassFile(Schema):
    """Keys of one bypass valve."""

    name: str = ""
    travel: Annotated[float, TRAVEL] = 0.5
    bore: Annotated[float, Physical("m", 5e-4, 0.1, 6e-3)] = 6e-3
    needle: Annotated[Any, Under(lambda: (NeedleFile, CalibratedNeedleFile, NeedleReference))]


class NeedleFile(Schema):
    """Keys of a needle valve with the equal-percentage law."""

    maximum: Annotated[float, LEAKAGE]
    rangeability: Annotated[float, Physical("", 1.001, 1000.0, 50.0)] = 50.0


class _Points(Field):
    """The annotation of a calibration table, [[opening, coefficient], ...].

    `parse` returns pairs of an opening from 0 to 1 and a coefficient in m^3/(s Pa^0.5).
    """

    def parse(self, raw: object) -> list[tuple[float, float]]:
        if not isinstance(raw, list) or not all(isinstance(p, list) and len(p) == 2 for p in raw):
            example = "[[0, 0 m^3/(s Pa^0.5)], [1, 2e-8 m^3/(s Pa^0.5)]]"
            raise QuantityError("is not a list of [opening, coefficient]", f"write {example}")
        share = Physical("", 0.0, 1.0, 0.5)
        return [(share.parse(opening), LEAKAGE.parse(coefficient)) for opening, coefficient in raw]


class CalibratedNeedleFile(Schema):
    """Keys of a calibrated needle valve: its table, and day and name of the calibration."""

    points: Annotated[list[tuple[float, float]], _Points()]
    date: datetime.date | None = None
    id: str = "needle"


class ReturnValveFile(Schema):
    """Keys of the valve in the return line."""

    name: str = "return valve"
    travel: Annotated[float, TRAVEL] = 0.5
    maximum: Annotated[float, RESISTANCE]


def read_bypass_valves(item: Located | None) -> dict[str, BypassValve]:
    """Return fault -> bypass valve for the usable valves of a rig file; record all problems."""
    if item is None:
        return {}
    if not isinstance(item.value, dict):
        item.refuse("is not a mapping", f"keys: {', '.join(BYPASS_KINDS)}", "")
    valves = {}
    for kind, entry in item.items():
        if kind not in BYPASS_KINDS:
            remedy = suggestion(kind, BYPASS_KINDS, "bypasses")
            if kind == Verdict.RETURN_BLOCKAGE:
                remedy = "describe the valve of the return line as `return_valve: ...`"
            entry.refuse("has no bypass", remedy, "")
            continue
        valve = _read_bypass(kind, entry)
        if valve is not None:
            valves[kind] = valve
    return valves


def read_return_valve(item: Located | None) -> ReturnValve | None:
    """Return the valve of the return line; None if the file describes none, or an unusable one.

    Problems are recorded.
    """
    file = read_mapping(ReturnValveFile, item)
    return ReturnValve(file.name, file.travel, file.maximum) if file else None


def _read_bypass(kind: str, item: Located) -> BypassValve | None:
    file = read_mapping(BypassFile, item)
    entry = item.get("needle")
    if entry is not None and file is not None and entry.get("calibration") is not None:
        entry = find_needle(kind, entry)
    if file is None or entry is None:
        return None
    try:
        needle = _read_needle(entry)
        name = file.name or f"bypass {kind}"
        return BypassValve(name, file.travel, needle, file.bore) if needle else None
    except RequestError as error:
        for each in error.problems:
            entry.refuse(each.limit, each.remedy, each.value, name=each.field)
        return None


def _read_needle(item: Located) -> NeedleCharacteristic | None:
    if item.get("points") is not None:
        table = read_mapping(CalibratedNeedleFile, item)
        from_table = NeedleCharacteristic.from_table
        return from_table(table.points, table.date, table.id) if table else None
    law = read_mapping(NeedleFile, item)
    return NeedleCharacteristic.equal_percentage(law.maximum, law.rangeability) if law else None
