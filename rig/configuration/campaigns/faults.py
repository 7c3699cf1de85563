"""The `faults` of a test are read here, sized by needle opening, coefficient or flow."""

from dataclasses import dataclass
from math import inf, sqrt
from typing import Annotated, Any, Final, Literal, NamedTuple

from control import RequestError
from faults import LEAK_KINDS, BypassValve, Fault, Verdict
from rig.configuration.reading import (
    Located,
    Physical,
    Problems,
    QuantityError,
    Schema,
    elements_of,
    read_mapping,
    show,
    shown,
)
from rig.configuration.rigs import LEAKAGE, RESISTANCE, Rig, valves_of
from rig.plant import quantities

TYPICAL_PRESSURE: Final = 6.9e6
"""Pressure drop in Pa at which flows are stated: half the supply pressure of section 2.1.

The pressure in a chamber is usually near this value.
"""

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
    at: Time
    until: Annotated[float | None, Physical("s", 0.0, 3600.0, 30.0)] = None
    ramp: Annotated[float, Physical("s", 0.0, 3600.0, 5.0)] = 0.0
    needle_opening: Annotated[float | None, Physical("", 0.0, 1.0, 0.3)] = None
    coefficient: Any = None
    linear_coefficient: Annotated[float | None, LINEAR_LEAKAGE] = None
    flow: Annotated[float | None, Physical("m^3/s", 0.0, 1e-3, 1e-5)] = None
    pressure: Annotated[float | None, Physical("Pa", 1e3, 3.5e7, TYPICAL_PRESSURE)] = None


def read_faults(
    item: Located | None, duration_s: float | None, rig: Rig | None, problems: Problems
) -> tuple[Fault, ...]:
    """Return the faults of a test that the rig can inject; record the others as problems.

    Of two faults of the same kind that overlap in time, only the first in the list is returned.

    Args:
        item: the list under the key `faults`; None or "none" if there are no faults.
        duration_s: duration of the test, within which faults must lie; None if it is not known.
        rig: the rig; without one no fault is returned, but the keys are still checked.
        problems: takes the mistakes.
    """
    if item is None or item.value == "none":
        return ()
    remedy = "write a list: - {type: ..., at: ..., flow: ..., pressure: ...}"
    accepted: list[Fault] = []
    for element in elements_of(item, problems, remedy):
        fault = _FaultReader(element, rig, problems).read(duration_s)
        if fault is not None and not _is_taken(fault, accepted, element, problems):
            accepted.append(fault)
    return tuple(accepted)


def _is_taken(fault: Fault, others: list[Fault], item: Located, problems: Problems) -> bool:
    for other in others:
        if other.kind == fault.kind and other.at_s < fault.end_s and fault.at_s < other.end_s:
            text = f"is there already from {other.at_s:g} s on"
            remedy = "one place leaks once at a time: leave one out, or end it with `until`"
            problems.add(item.find(("type",)).place, "type", fault.kind, text, remedy)
            return True
    return False


@dataclass
class _FaultReader:
    """A reader of one fault of a test."""

    item: Located
    rig: Rig | None
    problems: Problems

    def _add(self, key: str, value: object, limit: str, remedy: str) -> None:
        self.problems.add(self.item.find((key,)).place, key, value, limit, remedy)

    def read(self, duration_s: float | None) -> Fault | None:
        before = self.problems.reported
        file = read_mapping(FaultFile, self.item, self.problems)
        if file is None:
            return None
        self._check_times(file, duration_s)
        sized = self._has_one_size(file)
        if self.problems.reported > before or not sized or self.rig is None:
            return None
        if self.rig.backend == "hardware" and not self._is_movable(file, self.rig):
            return None
        if file.type == Verdict.RETURN_BLOCKAGE:
            return self._blockage(file, self._coefficient(file, RESISTANCE), self.rig)
        return self._leak(file, self._coefficient(file, LEAKAGE), self.rig)

    def _check_times(self, file: FaultFile, duration_s: float | None) -> None:
        for key, time in (("at", file.at), ("until", file.until)):
            if time is None or duration_s is None:
                continue
            if time > duration_s or (key == "at" and time == duration_s):
                self._add(
                    key,
                    shown(self.item.find((key,))),
                    f"is beyond the test's {duration_s:g} s",
                    "choose a time within the test, or lengthen its duration",
                )
        if file.until is not None and file.until <= file.at:
            self._add("until", f"{file.until:g} s", f"is not after at ({file.at:g} s)", "swap them")

    def _has_one_size(self, file: FaultFile) -> bool:
        allowed = self._sizes(file)
        given = [key for key in SIZES if self._is_given(key)]
        listing = ", ".join(f"{key} with pressure" if key == "flow" else key for key in allowed)
        for key in given:
            if key not in allowed:
                limit = f"is no size of a {file.type.replace('_', ' ')}"
                self._add(key, "", limit, f"give one of {listing}")
        if len(given) != 1:
            found = f"gives {' and '.join(given)}" if given else "has no size"
            self.problems.add(self.item.place, file.type, "", found, f"give one of {listing}")
            return False
        if self._is_given("flow") and not self._is_given("pressure"):
            remedy = "add `pressure: 6.9 MPa`; a flow counts at a stated pressure drop"
            self._add("flow", "", "is given without pressure", remedy)
            return False
        if self._is_given("pressure") and not self._is_given("flow"):
            remedy = "give the flow at that pressure drop, or leave the pressure out"
            self._add("pressure", "", "is given without flow", remedy)
            return False
        return given[0] in allowed

    def _is_given(self, key: str) -> bool:
        return self.item.find((key,)).name == key and self.item.find((key,)).value is not None

    def _sizes(self, file: FaultFile) -> tuple[str, ...]:
        if file.type == Verdict.RETURN_BLOCKAGE:
            return ("coefficient", "flow")
        return SIZES if file.type in LEAK_KINDS else tuple(s for s in SIZES if "linear" not in s)

    def _is_movable(self, file: FaultFile, rig: Rig) -> bool:
        """Return whether the valves of a hardware rig can make the fault; else record a problem.

        A driver must move the valves, and the fault must follow the square-root law of a needle.
        """
        fitted = {**rig.bypass_valves, str(Verdict.RETURN_BLOCKAGE): rig.return_valve}
        if fitted.get(file.type) is not None and file.type not in rig.injectable:
            outputs = " and ".join(valves_of(file.type))
            limit = f"needs valves that no driver of the rig {rig.name} moves"
            remedy = f"add a driver that writes {outputs}, or leave the fault out"
            self._add("type", file.type, limit, remedy)
            return False
        if file.linear_coefficient is not None:
            shown_value = shown(self.item.find(("linear_coefficient",)))
            remedy = "give needle_opening, coefficient, or flow with pressure"
            self._add("linear_coefficient", shown_value, "is a law no needle follows", remedy)
            return False
        return True

    def _coefficient(self, file: FaultFile, physical: Physical) -> float | None:
        entry = self.item.find(("coefficient",))
        if file.coefficient is None:
            return None
        try:
            return physical.parse(entry.value)
        except QuantityError as error:
            remedy = error.remedy
            if file.type in LEAK_KINDS and "Pa)" in str(entry.value).replace("Pa^0.5)", ""):
                remedy = "for m^3/(s Pa), the linear law, write linear_coefficient"
            self._add("coefficient", shown(entry), error.limit, remedy)
            return None

    def _blockage(self, file: FaultFile, coefficient: float | None, rig: Rig) -> Fault | None:
        valve = rig.return_valve
        if valve is None:
            remedy = "describe it in the rig file as `return_valve: ...`, or use another rig"
            self._add("type", file.type, f"needs a valve that the rig {rig.name} lacks", remedy)
            return None
        most, shown_most = valve.maximum, show(valve.maximum, RESISTANCE.unit)
        if file.flow is not None and file.pressure is not None:
            # A turbulent restriction has dp = R q^2, so that zero flow would need an infinite R.
            resistance = file.pressure / file.flow**2 if file.flow else inf
            reached = show(most * file.flow**2, "Pa")
            shown_most = f"{reached} at {show(file.flow, 'm^3/s')}"
            size = _Size("pressure", resistance, most, shown_most)
        else:
            size = _Size("coefficient", coefficient, most, shown_most)
        if not self._is_within(size, f"the {valve.name} of the rig {rig.name}"):
            return None
        return self._fault(file, size, travel_s=valve.travel_s)

    def _leak(self, file: FaultFile, coefficient: float | None, rig: Rig) -> Fault | None:
        valve = rig.bypass_valves.get(file.type)
        if valve is None:
            has = ", ".join(rig.bypass_valves) or "none"
            self._add(
                "type",
                file.type,
                f"needs a bypass valve that the rig {rig.name} lacks",
                f"it has: {has}; add the valve to the rig file, or use another rig",
            )
            return None
        size = self._leak_size(file, coefficient, valve)
        if not self._is_within(size, f"the {valve.name} of the rig {rig.name}"):
            return None
        return self._fault(file, size, valve.ball_travel_s, valve.ball_coefficient)

    def _leak_size(self, file: FaultFile, coefficient: float | None, valve: BypassValve) -> "_Size":
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

    def _is_within(self, size: "_Size", of: str) -> bool:
        if size.coefficient is None:
            return False
        value = shown(self.item.find((size.key,)))
        if size.coefficient > size.maximum * (1.0 + _ROUNDING):
            self._add(size.key, value, f"is above the {size.shown_maximum} of {of}", "ask for less")
            return False
        if size.coefficient <= 0.0:
            self._add(size.key, value, "is no fault", "ask for more, or leave the fault out")
            return False
        if size.coefficient < size.minimum * (1.0 - _ROUNDING):
            least = show(size.minimum, LEAKAGE.unit)
            remedy = "ask for more, or fit a finer needle"
            self._add(size.key, value, f"is below the {least} of {of}, its needle shut", remedy)
            return False
        return True

    def _fault(
        self,
        file: FaultFile,
        size: "_Size",
        travel_s: float,
        ball_coefficient: float | None = None,
    ) -> Fault | None:
        assert size.coefficient is not None
        try:
            return Fault(
                file.type,
                size.coefficient,
                linear=size.key == "linear_coefficient",
                at_s=file.at,
                until_s=inf if file.until is None else file.until,
                ramp_s=file.ramp,
                travel_s=travel_s,
                ball_coefficient=ball_coefficient,
            )
        except RequestError as error:
            for problem in error.problems:
                key = size.key if problem.field == "coefficient" else problem.field
                self._add(key.removesuffix("_s"), problem.value, problem.limit, problem.remedy)
            return None


class _Size(NamedTuple):
    """The size of a fault, the key that gives it, and the range of sizes that its valve can make.

    Coefficients are in SI; `coefficient` is None if the file's value is wrong. `shown_maximum` is
    the maximum as text, in the terms of the key.
    """

    key: str
    coefficient: float | None
    maximum: float
    shown_maximum: str
    minimum: float = 0.0
