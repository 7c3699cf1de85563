"""The `faults` of a test are read here, sized by needle opening, coefficient or flow."""

from collections.abc import Iterator
from math import inf, sqrt
from typing import Annotated, Any, Final, Literal, NamedTuple

from control import RequestError
from faults import LEAK_KINDS, TYPICAL_PRESSURE, BypassValve, Fault, Verdict, linked
from rig.configuration.reading import (
    AnyQuantity,
    Located,
    Physical,
    QuantityError,
    Schema,
    Under,
    Written,
    elements_of,
    read_mapping,
    refuse_missing,
    show,
)
from rig.configuration.rigs import LEAKAGE, RESISTANCE, Rig, valves_of
from rig.plant import quantities

LINEAR_LEAKAGE: Final = Physical(
    "m^3/(s Pa)", 0.0, quantities()["internal_leakage_linear"].upper, 2e-12
)
# A size that was computed from a limit may exceed it by this fraction, through rounding.
_ROUNDING: Final = 1e-9
SIZES: Final = ("needle_opening", "coefficient", "linear_coefficient", "flow")
Time = Annotated[float, Physical("s", 0.0, 3600.0, 18.0)]


class FaultFile(Schema):
    """Keys of a fault; the unit of `coefficient` depends on the fault's type."""

    type: Literal[
        Verdict.EXTERNAL_LEAKAGE_1,
        Verdict.EXTERNAL_LEAKAGE_2,
        Verdict.INTERNAL_LEAKAGE,
        Verdict.SUPPLY_LEAKAGE,
        Verdict.RETURN_BLOCKAGE,
    ]
    at: Time | None = None
    until: Annotated[float | None, Physical("s", 0.0, 3600.0, 30.0)] = None
    ramp: Annotated[float, Physical("s", 0.0, 3600.0, 5.0)] = 0.0
    needle_opening: Annotated[float | None, Physical("", 0.0, 1.0, 0.3)] = None
    coefficient: Annotated[Any, AnyQuantity()] = None
    linear_coefficient: Annotated[float | None, LINEAR_LEAKAGE] = None
    flow: Annotated[float | None, Physical("m^3/s", 0.0, 1e-3, 1e-5)] = None
    pressure: Annotated[float | None, Physical("Pa", 1e3, 3.5e7, TYPICAL_PRESSURE)] = None
    profile: Annotated[Any, Under(lambda: (ProfileEntryFile,), many=True)] = None


class ProfileEntryFile(Schema):
    """Keys of an entry of a fault's `profile`: from when on the fault has which size."""

    at: Time
    until: Annotated[Any, Written("s")] = None
    ramp: Annotated[Any, Written("s")] = 0.0
    needle_opening: Annotated[Any, Written("")] = None
    coefficient: Annotated[Any, AnyQuantity()] = None
    linear_coefficient: Annotated[Any, Written("m^3/(s Pa)")] = None
    flow: Annotated[Any, Written("m^3/s")] = None
    pressure: Annotated[Any, Written("Pa")] = None


class _Size(NamedTuple):
    """The size of a fault, the key that gives it, and the range of sizes that its valve can make.

    `coefficient`, `minimum` and `maximum` are coefficients of the fault in SI; `coefficient` is
    None if the file's value is wrong. `shown_maximum` is the maximum for messages, as text in the
    quantity of the key, such as a flow.
    """

    key: str
    coefficient: float | None
    maximum: float
    shown_maximum: str
    minimum: float = 0.0


def read_faults(
    item: Located | None, duration_s: float | None, rig: Rig | None
) -> tuple[Fault, ...]:
    """Return the faults of a test that the rig can inject; record the others as problems.

    Of two faults of the same kind that overlap in time, only the first in the list is returned.

    Args:
        item: the list under the key `faults`; None or "none" if there are no faults.
        duration_s: duration of the test, within which faults must lie; None if it is not known.
        rig: the rig; without one no fault is returned, but the keys are still checked.
    """
    if item is None or item.value == "none":
        return ()
    remedy = "write a list: - {type: ..., at: ..., flow: ..., pressure: ...}"
    accepted: list[Fault] = []
    for element in elements_of(item, remedy):
        for window in _windows(element):
            fault = _read_fault(window, duration_s, rig)
            if fault is not None and not _is_taken(fault, accepted, window):
                accepted.append(fault)
    # In the order of the file, as ever, unless faults meet at one place.
    return linked(accepted) if _meet(accepted) else tuple(accepted)


def _meet(faults: list[Fault]) -> bool:
    return any(fault.goes_on for fault in linked(faults))


def _is_taken(fault: Fault, others: list[Fault], item: Located) -> bool:
    """Return whether another fault is at the same place at some time of this one; record that.

    A fault may begin at the very time at which the other ends: the bypass then stays open. Shortly
    after that its ball is still shutting.
    """
    for other in others:
        if other.kind != fault.kind:
            continue
        first, second = linked((other, fault))
        if first.goes_on and first.until_s - first.at_s < first.travel_s:
            limit = f"begins before the ball valve has opened, {first.travel_s:g} s after the last"
            item.refuse(limit, "let the one before last longer", f"{second.at_s:g} s", "at")
            return True
        if second.at_s >= first.end_s:
            continue
        text = f"is there already from {other.at_s:g} s on"
        remedy = "one place leaks once at a time: leave one out, or end it with `until`"
        if second.at_s > first.until_s:
            text = f"comes while the ball valve of the one before shuts, until {first.end_s:g} s"
            remedy = f"begin at {first.until_s:g} s, and the ball stays open, or after it has shut"
        item.refuse(text, remedy, fault.kind, "type")
        return True
    return False


def _windows(item: Located) -> Iterator[Located]:
    """Yield a fault as it is; one with a `profile`, as one fault for each of its entries.

    Each entry has the keys of the fault unless it gives them itself, and lasts until the next one
    begins, the last one until the fault ends.
    """
    profile = item.get("profile")
    if profile is None:
        yield item
        return
    for key in ("at", "ramp", *SIZES):
        if item.get(key) is not None:
            limit = "is given beside a profile, whose entries have their own"
            item.refuse(limit, "move it into the profile", key=key)
            return
    entries = elements_of(profile, "write a list: - {at: ..., flow: ...}")
    if not entries:
        profile.refuse("has no entry", "write a list: - {at: ..., flow: ...}", "")
    read = [read_mapping(ProfileEntryFile, entry) for entry in entries]
    if not _are_in_order(entries, read):
        return
    shared = {key: entry for key, entry in item.items() if key in ("type", "pressure", "until")}
    for index, entry in enumerate(entries):
        if read[index] is None:
            continue
        given = {key: each for key, each in entry.items() if key in ProfileEntryFile.model_fields}
        following = entries[index + 1].get("at") if index + 1 < len(entries) else None
        usual = dict(shared)
        if following is not None:
            usual["until"] = following
        if entry.get("flow") is None:
            usual.pop("pressure", None)
        yield entry.with_value({**usual, **given})


def _are_in_order(entries: list[Located], read: list[ProfileEntryFile | None]) -> bool:
    """Return whether each entry of a profile begins after the one before; if not, record why.

    An entry with an `until` of its own does not last until the next one, which may begin anywhere.

    Args:
        entries: the entries.
        read: the keys of each; None for an unusable one.
    """
    ordered = True
    for index in range(1, len(entries)):
        before, own = read[index - 1], read[index]
        if before is None or own is None or before.until is not None or own.at > before.at:
            continue
        limit = f"is not after the entry before, which begins at {before.at:g} s"
        entries[index].refuse(limit, "give the entries in the order of their times", key="at")
        ordered = False
    return ordered


def _read_fault(item: Located, duration_s: float | None, rig: Rig | None) -> Fault | None:
    problems = item.sources.problems
    before = problems.reported
    file = read_mapping(FaultFile, item)
    if file is None:
        return None
    if file.at is None:
        if item.get("at") is None:
            refuse_missing(item, "at", FaultFile.model_fields)
        return None
    _check_times(item, file, duration_s)
    _check_size(item, file)
    if problems.reported > before or rig is None:
        return None
    if rig.backend == "hardware" and not _is_movable(item, file, rig):
        return None
    blocks = file.type == Verdict.RETURN_BLOCKAGE
    coefficient = _coefficient(item, file, RESISTANCE if blocks else LEAKAGE)
    valve = rig.return_valve if blocks else rig.bypass_valves.get(file.type)
    if valve is None:
        _add_lacking(item, file, rig)
        return None
    if isinstance(valve, BypassValve):
        size, travel_s = _leak_size(file, coefficient, valve), valve.ball_travel_s
        ball_coefficient = valve.ball_coefficient
    else:
        size, travel_s = _blockage_size(file, coefficient, valve.maximum), valve.travel_s
        ball_coefficient = None
    at_s = file.at
    found, of = size.coefficient, f"the {valve.name} of the rig {rig.name}"
    if found is None or not _is_within(item, size, found, of):
        return None
    try:
        return Fault(
            file.type,
            found,
            linear=size.key == "linear_coefficient",
            at_s=at_s,
            until_s=inf if file.until is None else file.until,
            ramp_s=file.ramp,
            travel_s=travel_s,
            ball_coefficient=ball_coefficient,
        )
    except RequestError as error:
        for problem in error.problems:
            key = size.key if problem.field == "coefficient" else problem.field.removesuffix("_s")
            item.refuse(problem.limit, problem.remedy, problem.value, key)
        return None


def _check_times(item: Located, file: FaultFile, duration_s: float | None) -> None:
    for key, time in (("at", file.at), ("until", file.until)):
        if time is None or duration_s is None:
            continue
        if time > duration_s or (key == "at" and time == duration_s):
            remedy = "choose a time within the test, or lengthen its duration"
            item.refuse(f"is beyond the test's {duration_s:g} s", remedy, key=key)
    if file.until is not None and file.at is not None and file.until <= file.at:
        limit = f"is not after at ({file.at:g} s)"
        item.refuse(limit, "swap them", f"{file.until:g} s", "until")


def _check_size(item: Located, file: FaultFile) -> None:
    """Record a problem unless a fault has exactly one size, of a key that its type allows.

    A problem is also a flow without a pressure, or a pressure without a flow.
    """
    allowed = _sizes(file)
    given = [key for key in SIZES if item.get(key) is not None]
    listing = ", ".join(f"{key} with pressure" if key == "flow" else key for key in allowed)
    for key in given:
        if key not in allowed:
            limit = f"is no size of a {file.type.replace('_', ' ')}"
            item.refuse(limit, f"give one of {listing}", "", key)
    flow, pressure = (item.get(key) is not None for key in ("flow", "pressure"))
    if len(given) != 1:
        found = f"gives {' and '.join(given)}" if given else "has no size"
        item.refuse(found, f"give one of {listing}", "", name=file.type)
    elif flow and not pressure:
        remedy = "add `pressure: 6.9 MPa`; a flow counts at a stated pressure drop"
        item.refuse("is given without pressure", remedy, "", "flow")
    elif pressure and not flow:
        remedy = "give the flow at that pressure drop, or leave the pressure out"
        item.refuse("is given without flow", remedy, "", "pressure")


def _sizes(file: FaultFile) -> tuple[str, ...]:
    if file.type == Verdict.RETURN_BLOCKAGE:
        return ("coefficient", "flow")
    return SIZES if file.type in LEAK_KINDS else tuple(s for s in SIZES if "linear" not in s)


def _is_movable(item: Located, file: FaultFile, rig: Rig) -> bool:
    """Return whether the valves of a hardware rig can make the fault; else record a problem.

    A driver must move the valves, and the fault must follow the square-root law of a needle. A rig
    that lacks the valve itself is left to the caller.
    """
    fitted = {**rig.bypass_valves, str(Verdict.RETURN_BLOCKAGE): rig.return_valve}
    if fitted.get(file.type) is not None and file.type not in rig.injectable:
        outputs = " and ".join(valves_of(file.type))
        limit = f"needs valves that no driver of the rig {rig.name} moves"
        remedy = f"add a driver that writes {outputs}, or leave the fault out"
        item.refuse(limit, remedy, file.type, "type")
        return False
    if file.linear_coefficient is not None:
        remedy = "give needle_opening, coefficient, or flow with pressure"
        item.refuse("is a law no needle follows", remedy, key="linear_coefficient")
        return False
    return True


def _coefficient(item: Located, file: FaultFile, physical: Physical) -> float | None:
    entry = item.find("coefficient")
    if file.coefficient is None:
        return None
    try:
        return physical.parse(entry.value)
    except QuantityError as error:
        remedy = error.remedy
        if file.type in LEAK_KINDS and "Pa)" in str(entry.value).replace("Pa^0.5)", ""):
            remedy = "for m^3/(s Pa), the linear law, write linear_coefficient"
        entry.refuse(error.limit, remedy)
        return None


def _add_lacking(item: Located, file: FaultFile, rig: Rig) -> None:
    """Record that a rig lacks the valve that makes a fault."""
    if file.type == Verdict.RETURN_BLOCKAGE:
        valve = "valve"
        remedy = "describe it in the rig file as `return_valve: ...`, or use another rig"
    else:
        valve, has = "bypass valve", ", ".join(rig.bypass_valves) or "none"
        remedy = f"it has: {has}; add the valve to the rig file, or use another rig"
    item.refuse(f"needs a {valve} that the rig {rig.name} lacks", remedy, file.type, "type")


def _blockage_size(file: FaultFile, coefficient: float | None, most: float) -> _Size:
    if file.flow is None or file.pressure is None:
        return _Size("coefficient", coefficient, most, show(most, RESISTANCE.unit))
    # A turbulent restriction has dp = R q^2, so that zero flow would need an infinite R.
    resistance = file.pressure / file.flow**2 if file.flow else inf
    shown_most = f"{show(most * file.flow**2, 'Pa')} at {show(file.flow, 'm^3/s')}"
    return _Size("pressure", resistance, most, shown_most)


def _leak_size(file: FaultFile, coefficient: float | None, valve: BypassValve) -> _Size:
    most, least = valve.maximum, valve.minimum
    if file.flow is not None and file.pressure is not None:
        root = sqrt(file.pressure)
        shown_most = f"{show(most * root, 'm^3/s')} at {show(file.pressure, 'Pa')}"
        return _Size("flow", file.flow / root, most, shown_most, least)
    if file.needle_opening is not None:
        return _Size("needle_opening", valve.effective(file.needle_opening), most, "1")
    if file.linear_coefficient is not None:
        # No needle leaks linearly, so the limit is its flow at the typical pressure drop.
        most /= sqrt(TYPICAL_PRESSURE)
        shown_most = show(most, LINEAR_LEAKAGE.unit)
        return _Size("linear_coefficient", file.linear_coefficient, most, shown_most)
    return _Size("coefficient", coefficient, most, show(most, LEAKAGE.unit), least)


def _is_within(item: Located, size: _Size, coefficient: float, of: str) -> bool:
    if coefficient > size.maximum * (1.0 + _ROUNDING):
        limit, remedy = f"is above the {size.shown_maximum} of {of}", "ask for less"
    elif coefficient <= 0.0:
        limit, remedy = "is no fault", "ask for more, or leave the fault out"
    elif coefficient < size.minimum * (1.0 - _ROUNDING):
        limit = f"is below the {show(size.minimum, LEAKAGE.unit)} of {of}, its needle shut"
        remedy = "ask for more, or fit a finer needle"
    else:
        return True
    item.refuse(limit, remedy, key=size.key)
    return False
