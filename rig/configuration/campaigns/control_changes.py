"""The `control_changes` of a test: times from which another control holds while the test runs."""

from math import inf
from typing import Annotated, Any, Final

from control import ControlSettings
from faults import ControlFrom
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Under,
    elements_of,
    options_schema,
    read_mapping,
    show,
)
from rig.configuration.rigs import read_control

_EXAMPLE: Final = "write a list: - {at: 12 s, control: {gain: 80 V/m}}"


class ControlChangeFile(Schema):
    """Keys of a change of the control of a running test."""

    at: Annotated[float, Physical("s", 0.0, inf)]
    control: Annotated[
        Any, Under(lambda: (options_schema(ControlSettings),), words=("proportional",))
    ]


def read_control_changes(
    item: Located | None, first: ControlSettings, lasts_s: float | None, quantity: str | None
) -> tuple[ControlFrom, ...]:
    """Return the usable changes of a test's control; record the problems of the others.

    Keys that a change does not give are those of the control before it.

    Args:
        item: the list; None if there is none.
        first: the control with which the test begins.
        lasts_s: duration of the test, s; None if it is unusable.
        quantity: what the test's setpoint is, "position" or "command"; None if it is unusable.
    """
    if item is not None and quantity == "command":
        limit = "needs a position loop, and this setpoint is the valve command itself"
        item.refuse(limit, "leave it out, or give a setpoint in m", value="")
        return ()
    found: list[ControlFrom] = []
    for element in elements_of(item, _EXAMPLE):
        file = read_mapping(ControlChangeFile, element)
        given = element.get("control")
        settings = None if given is None else read_control(given, first)
        if file is None or settings is None:
            continue
        if given is not None and given.value == {}:
            remedy = "give a key of the control, such as `gain: 80 V/m`, or leave the change out"
            element.refuse("changes nothing", remedy, "an empty mapping", key="control")
            continue
        before_s = found[-1].at_s if found else 0.0
        if file.at <= before_s:
            what = "the change before" if found else "the begin of the test"
            limit = f"is not after {what} at {show(before_s, 's')}"
            element.refuse(limit, "give the changes in the order of their times", key="at")
        elif lasts_s is not None and file.at >= lasts_s:
            limit = f"is not before the end of the test at {show(lasts_s, 's')}"
            element.refuse(limit, "let it come before the end", key="at")
        else:
            found.append(ControlFrom(file.at, settings))
            first = settings
    return tuple(found)
