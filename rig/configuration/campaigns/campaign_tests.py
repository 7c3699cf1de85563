"""The tests of a campaign file are read here, one for each matrix combination and repeat.

Each test is checked against the limits of the rig.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import numpy as np
from pydantic import Field as SchemaField

from control import ControlSettings, Setpoint
from faults import CampaignTest, Fault, OnFault, SpringLoad, Verdict
from rig.configuration.reading import Located, Physical, Schema, expand, read_mapping, show
from rig.configuration.rigs import Rig, read_control
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
    control: Any = None
    matrix: Any = None


class LoadFile(Schema):
    """Keys of a spring load."""

    stiffness: Annotated[float, Physical("N/m", 1.0, _STIFFNESS.upper, 2e4)]
    contact: Annotated[float, Physical("m", _CONTACT.lower, _CONTACT.upper, 0.22)]


def read_tests(
    tests: Located, defaults: Located | None, rig: Rig | None
) -> tuple[CampaignTest, ...]:
    """Return every usable test of a campaign; record the problems of the others.

    There is one for each matrix combination and repeat. If a test has several repeats, they are
    named "name #1" and so on.

    Args:
        tests: the list under the key `tests`; paths of setpoint files count from its file's folder.
        defaults: keys that every test gets unless it gives them itself; None if there are none.
        rig: the rig whose limits the tests are checked against; None if it is unusable.
    """
    read: list[CampaignTest] = []
    names: dict[str, Located] = {}
    for element in tests.elements():
        if not isinstance(element.value, dict):
            element.refuse("is no test", "write `- name: ...` with its keys below")
            continue
        for item in expand(element.completed_by(defaults)):
            name = item.get("name")
            if name is not None and str(name.value) in names:
                _add_duplicate(name, names[str(name.value)])
            elif name is not None:
                names[str(name.value)] = name
            read += _TestReader(item, tests.place.path.parent, rig).read()
    return tuple(read)


def _add_duplicate(name: Located, first: Located) -> None:
    same = first.place == name.place
    if same and name.sources.problems.has_at(name.place):
        return
    where = "for several tests of the matrix" if same else f"in line {first.place.line} too"
    remedy = "write every axis into the name, as ${axis}" if same else "choose another name"
    name.refuse(f"is given {where}", remedy, str(name.value))


@dataclass
class _TestReader:
    """A reader of one test, whose matrix references are replaced by values already.

    `read` yields the test's usable repeats and records problems. Paths of setpoint files count from
    `folder`. If `rig` is None, limits are not checked.
    """

    item: Located
    folder: Path
    rig: Rig | None

    def read(self) -> Iterator[CampaignTest]:
        file = read_mapping(CampaignTestFile, self.item)
        load = self._load()
        control = self._control()
        duration_s = file.duration if file else None
        faults = read_faults(self.item.get("faults"), duration_s, self.rig)
        # The seed follows from the name, so that adding a test changes no other test's noise.
        seed = zlib.crc32(str(file.name).encode()) >> 1 if file else 0
        if file is not None and file.seed is not None:
            seed = file.seed
        for index in range(file.repeats if file else 1):
            setpoint = self._setpoint(file.duration if file else 60.0, seed + index)
            if file is None or setpoint is None:
                continue
            self._check_on_fault(file.on_fault, setpoint)
            start = self._start_position(file, setpoint)
            if start is None:
                continue
            yield CampaignTest(
                name=file.name if file.repeats == 1 else f"{file.name} #{index + 1}",
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
                control=control,
            )

    def _setpoint(self, duration_s: float, seed: int) -> Setpoint | None:
        item = self.item.get("setpoint")
        if item is None:
            return None
        setpoint = read_setpoint(item, SetpointContext(duration_s, seed, self.folder))
        if setpoint is not None and self.rig is not None:
            _check_against_limits(setpoint, duration_s, item, self.rig)
        return setpoint

    def _check_on_fault(self, on_fault: OnFault, setpoint: Setpoint) -> None:
        item = self.item.get("on_fault")
        if item is None or on_fault != OnFault.TOLERATE or setpoint.quantity == "position":
            return
        limit = "needs a position loop, and this setpoint is the valve command itself"
        item.refuse(limit, "give the test another on_fault, or a setpoint in m")

    def _start_position(self, file: CampaignTestFile, setpoint: Setpoint) -> float | None:
        start, limits = file.start_position, self.rig.limits if self.rig else None
        if start is None:
            if setpoint.quantity == "position":
                return float(setpoint.sample(np.zeros(1))[0])
            return 0.5 * (limits.position_min_m + limits.position_max_m) if limits else None
        if self.rig is None or limits is None:
            return start
        lower, upper = limits.position_min_m, limits.position_max_m
        if lower <= start <= upper:
            return start
        stretch = f"{show(lower, 'm')} to {show(upper, 'm')}"
        limit = f"is not within {stretch}, the position limits of the rig {self.rig.name}"
        self.item.refuse(limit, "start within them", key="start_position")
        return None

    def _control(self) -> ControlSettings | None:
        """Return the test's own control settings; None if it has none, or they are unusable."""
        item = self.item.get("control")
        return None if item is None else read_control(item, self.rig.control if self.rig else None)

    def _load(self) -> SpringLoad | None:
        item = self.item.get("load")
        if item is None or item.value == "none":
            return None
        file = read_mapping(LoadFile, item)
        if file is None:
            return None
        if self.rig is not None:
            par = self.rig.plant.parameters
            if not par.stroke_min <= file.contact <= par.stroke_max:
                stroke = f"{show(par.stroke_min, 'm')} to {show(par.stroke_max, 'm')}"
                remedy = "place the spring where the ram meets it"
                item.refuse(f"is outside the stroke of {stroke}", remedy, key="contact")
                return None
        return SpringLoad(file.stiffness, file.contact)


def _check_against_limits(setpoint: Setpoint, duration_s: float, item: Located, rig: Rig) -> None:
    limits = rig.limits.of(setpoint.quantity)
    times = np.arange(round(duration_s / TICK)) * TICK
    values = setpoint.sample(times)
    worst = int(np.argmax(np.maximum(values - limits.upper, limits.lower - values)))
    value = float(values[worst])
    if limits.lower <= value <= limits.upper:
        return
    above = value > limits.upper
    end = show(limits.upper if above else limits.lower, limits.unit)
    limit = f"is {'above' if above else 'below'} the {end} of the rig {rig.name}"
    is_position = setpoint.quantity == "position"
    remedy = "reduce or shift the motion" if is_position else "reduce the command"
    item.refuse(limit, remedy, f"{show(value, limits.unit)} at {times[worst]:.3f} s")


def _expected(faults: tuple[Fault, ...]) -> Verdict:
    """Return the verdict that is right for these faults: healthy, the one kind, or multiple."""
    kinds = {fault.kind for fault in faults}
    if not kinds:
        return Verdict.HEALTHY
    return Verdict(kinds.pop()) if len(kinds) == 1 else Verdict.MULTIPLE
