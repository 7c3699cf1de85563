"""The tests of a campaign file are read here, one for each matrix combination and repeat.

Each test is checked against the limits of the rig.
"""

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field as SchemaField

from control import Setpoint
from faults import CampaignTest, Fault, OnFault, SpringLoad, Verdict
from rig.configuration.reading import (
    Located,
    Physical,
    Problems,
    Schema,
    Sources,
    expand,
    read_mapping,
    show,
    shown,
)
from rig.configuration.rigs import Rig
from rig.plant import TICK, quantities

from .faults import read_faults
from .setpoints import SetpointContext, read_setpoint

_STIFFNESS: Final = quantities()["spring_stiffness"]
_CONTACT: Final = quantities()["spring_contact"]


class CampaignTestFile(Schema):
    """Keys of a test; keys that all tests share may be written once under `defaults`."""

    name: str
    duration: Annotated[float, Physical("s", 5.0, 3600.0, 40.0)]
    start_position: Annotated[float | None, Physical("m", -1.0, 6.0, 0.3)] = None
    settle: Annotated[float, Physical("s", 0.0, 600.0, 2.0)] = 2.0
    setpoint: Any
    load: Any = None
    faults: Any = None
    expect: Verdict | None = None
    on_fault: OnFault = OnFault.IGNORE
    repeats: Annotated[int, SchemaField(ge=1, le=1000)] = 1
    seed: Annotated[int | None, SchemaField(ge=0, lt=2**31)] = None
    matrix: Any = None


class LoadFile(Schema):
    """Keys of a spring load."""

    stiffness: Annotated[float, Physical("N/m", 1.0, _STIFFNESS.upper, 2e4)]
    contact: Annotated[float, Physical("m", _CONTACT.lower, _CONTACT.upper, 0.22)]


def read_tests(
    tests: Located, defaults: Located | None, folder: Path, rig: Rig | None, sources: Sources
) -> tuple[CampaignTest, ...]:
    """Return every usable test of a campaign; add the problems of the others to the sources'.

    There is one for each matrix combination and repeat; repeats are named "name #1" and so on.

    Args:
        tests: the list under the key `tests`.
        defaults: keys that every test gets unless it gives them itself; None if there are none.
        folder: folder from which the paths of setpoint files are resolved.
        rig: the rig whose limits the tests are checked against; None if it is unusable.
        sources: takes the problems and the files that are read.
    """
    read: list[CampaignTest] = []
    names: dict[str, Located] = {}
    for element in tests.elements():
        if not isinstance(element.value, dict):
            remedy = "write `- name: ...` with its keys below"
            sources.problems.add(element.place, element.name, shown(element), "is no test", remedy)
            continue
        for item in expand(_with_defaults(element, defaults), sources.problems):
            name = item.get("name")
            if name is not None and str(name.value) in names:
                _add_duplicate(name, names[str(name.value)], sources.problems)
            elif name is not None:
                names[str(name.value)] = name
            read += _TestReader(item, folder, rig, sources).read()
    return tuple(read)


def _with_defaults(test: Located, defaults: Located | None) -> Located:
    shared = dict(defaults.items()) if defaults is not None else {}
    return Located({**shared, **dict(test.items())}, test.place, test.name)


def _add_duplicate(name: Located, first: Located, problems: Problems) -> None:
    same = first.place == name.place
    if same and problems.has_at(name.place):
        return
    where = "for several tests of the matrix" if same else f"in line {first.place.line} too"
    remedy = "write every axis into the name, as ${axis}" if same else "choose another name"
    problems.add(name.place, "name", str(name.value), f"is given {where}", remedy)


class _TestReader:
    """A reader of one test, whose matrix references are replaced by values already."""

    def __init__(self, item: Located, folder: Path, rig: Rig | None, sources: Sources) -> None:
        self.item = item
        self.folder = folder
        self.rig = rig
        self.sources = sources
        self.problems = sources.problems

    def read(self) -> Iterator[CampaignTest]:
        file = read_mapping(CampaignTestFile, self.item, self.problems)
        load = self._load()
        faults = read_faults(
            self.item.get("faults"), file.duration if file else None, self.rig, self.problems
        )
        repeats = file.repeats if file else 1
        # The seed follows from the name, so that adding a test changes no other test's noise.
        seed = zlib.crc32(str(file.name).encode()) >> 1 if file else 0
        if file is not None and file.seed is not None:
            seed = file.seed
        for index in range(repeats):
            setpoint = self._setpoint(file.duration if file else 60.0, seed + index)
            if file is None or setpoint is None:
                continue
            self._check_on_fault(file.on_fault, setpoint)
            start = self._start_position(file, setpoint)
            if start is None:
                continue
            yield CampaignTest(
                name=file.name if repeats == 1 else f"{file.name} #{index + 1}",
                test_name=file.name,
                duration_s=file.duration,
                start_position_m=start,
                settle_s=file.settle,
                setpoint=setpoint,
                load=load,
                faults=faults,
                expect=file.expect or _expected(faults),
                repeat=index + 1,
                seed=seed + index,
                on_fault=file.on_fault,
            )

    def _setpoint(self, duration_s: float, seed: int) -> Setpoint | None:
        item = self.item.get("setpoint")
        if item is None:
            return None
        setpoint = read_setpoint(item, SetpointContext(duration_s, seed, self.folder), self.sources)
        if setpoint is not None and self.rig is not None:
            self._check_against_limits(setpoint, duration_s, item, self.rig)
        return setpoint

    def _check_against_limits(
        self, setpoint: Setpoint, duration_s: float, item: Located, rig: Rig
    ) -> None:
        limits = rig.limits
        if setpoint.quantity == "position":
            unit, lower, upper = "m", limits.position_min_m, limits.position_max_m
            remedy = "reduce or shift the motion"
        else:
            unit, lower, upper = "V", -limits.command_V, limits.command_V
            remedy = "reduce the command"
        times = np.arange(round(duration_s / TICK)) * TICK
        values = setpoint.sample(times)
        worst = int(np.argmax(np.maximum(values - upper, lower - values)))
        if lower <= values[worst] <= upper:
            return
        above = values[worst] > upper
        limit = show(upper if above else lower, unit)
        self.problems.add(
            item.place,
            "setpoint",
            f"{show(float(values[worst]), unit)} at {times[worst]:.3f} s",
            f"is {'above' if above else 'below'} the {limit} of the rig {rig.name}",
            remedy,
        )

    def _check_on_fault(self, on_fault: OnFault, setpoint: Setpoint) -> None:
        item = self.item.get("on_fault")
        if item is None or on_fault != OnFault.TOLERATE or setpoint.quantity == "position":
            return
        limit = "needs a position loop, and this setpoint is the valve command itself"
        remedy = "give the test another on_fault, or a setpoint in m"
        self.problems.add(item.place, "on_fault", shown(item), limit, remedy)

    def _start_position(self, file: CampaignTestFile, setpoint: Setpoint) -> float | None:
        if file.start_position is None:
            if setpoint.quantity == "position":
                return float(setpoint.sample(np.zeros(1))[0])
            limits = self.rig.limits if self.rig else None
            return 0.5 * (limits.position_min_m + limits.position_max_m) if limits else None
        if self.rig is not None:
            lower, upper = self.rig.limits.position_min_m, self.rig.limits.position_max_m
            if not lower <= file.start_position <= upper:
                self.problems.add(
                    self.item.find(("start_position",)).place,
                    "start_position",
                    shown(self.item.find(("start_position",))),
                    f"is not within {show(lower, 'm')} to {show(upper, 'm')}, "
                    f"the position limits of the rig {self.rig.name}",
                    "start within them",
                )
                return None
        return file.start_position

    def _load(self) -> SpringLoad | None:
        item = self.item.get("load")
        if item is None or item.value == "none":
            return None
        file = read_mapping(LoadFile, item, self.problems)
        if file is None:
            return None
        if self.rig is not None:
            par = self.rig.plant.parameters
            if not par.stroke_min <= file.contact <= par.stroke_max:
                entry = item.find(("contact",))
                stroke = f"{show(par.stroke_min, 'm')} to {show(par.stroke_max, 'm')}"
                limit = f"is outside the stroke of {stroke}"
                remedy = "place the spring where the ram meets it"
                self.problems.add(entry.place, "contact", shown(entry), limit, remedy)
                return None
        return SpringLoad(file.stiffness, file.contact)


def _expected(faults: tuple[Fault, ...]) -> Verdict:
    """Return the verdict that is right for these faults: healthy, the one fault, or multiple."""
    kinds = {fault.kind for fault in faults}
    if not kinds:
        return Verdict.HEALTHY
    return Verdict(kinds.pop()) if len(kinds) == 1 else Verdict.MULTIPLE
