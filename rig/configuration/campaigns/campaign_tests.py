"""The tests of a campaign file are read here, one for each matrix combination and repeat.

Each test is checked against the limits of the rig.
"""

import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from pydantic import Field as SchemaField

from control import ControlSettings, Setpoint
from faults import CampaignTest, ControlFrom, Fault, OnFault, SpringLoad, Until, Verdict
from rig.configuration.reading import (
    MAX_TESTS,
    Located,
    Name,
    Physical,
    Schema,
    Under,
    elements_of,
    expand,
    options_schema,
    read_mapping,
    show,
)
from rig.configuration.rigs import GAIN, Rig, read_control
from rig.plant import quantities

from .awaited import awaited_files, read_awaited, read_until, until_files
from .control_changes import ControlChangeFile, read_control_changes
from .criteria import CriterionFile, OwnFigureFile, read_criteria, read_own_figures
from .faults import FaultFile, read_faults
from .leak_tests import KEYS, LEAK_TEST_S, LeakTestFile, place_of, read_leak_test
from .limits import TestLimitFile, read_test_limits
from .segments import Cycles, SegmentFile, SegmentLoopFile, Times, context_of, read_motion
from .setpoints import DURATION, setpoint_files

_STIFFNESS: Final = quantities()["spring_stiffness"]
_CONTACT: Final = quantities()["spring_contact"]
_IN_PLACE_OF: Final = {
    "cycles": ("duration",),
    "duration": ("cycles",),
    "segments": ("setpoint", "duration", "cycles", "until"),
    "setpoint": ("segments",),
    "until": ("duration", "cycles", "segments"),
}
"""Keys of a test, and the defaults that do not apply to a test which gives them itself."""


class CampaignTestFile(Schema):
    """Keys of a test; keys that all tests share may be written once under `defaults`."""

    name: Name
    duration: Annotated[float | None, DURATION] = None
    cycles: Cycles = None
    start_position: Annotated[float | None, Physical("m", -1.0, 6.0, 0.3)] = None
    settle: Annotated[float, Physical("s", 0.0, 600.0, 2.0)] = 2.0
    setpoint: Annotated[Any, Under(setpoint_files)] = None
    segments: Annotated[Any, Under(lambda: (SegmentFile, SegmentLoopFile), many=True)] = None
    until: Annotated[Any, Under(until_files)] = None
    wait_for: Annotated[Any, Under(awaited_files, many=True, or_one=True)] = None
    position_gain: Annotated[float | None, GAIN] = None
    load: Annotated[Any, Under(lambda: (LoadFile,), words=("none",))] = None
    faults: Annotated[Any, Under(lambda: (FaultFile,), many=True, words=("none",))] = None
    expect: Verdict | None = None
    on_fault: OnFault = OnFault.IGNORE
    repeats: Annotated[int, SchemaField(ge=1, le=1000)] = 1
    seed: Annotated[int | None, SchemaField(ge=0, lt=2**31)] = None
    figures: Annotated[Any, Under(lambda: (OwnFigureFile,), named=True)] = None
    criteria: Annotated[Any, Under(lambda: (CriterionFile,), many=True)] = None
    limits: Annotated[Any, Under(lambda: (TestLimitFile,), many=True)] = None
    control: Annotated[Any, Under(lambda: (options_schema(ControlSettings),))] = None
    control_changes: Annotated[Any, Under(lambda: (ControlChangeFile,), many=True)] = None
    matrix: Any = None
    leak_test: Annotated[Any, Under(lambda: (LeakTestFile,))] = None


class TestLoopFile(Schema):
    """Keys of a loop in the list of tests, which runs its tests as many times as `loop` says."""

    __test__ = False  # not a pytest class, whatever its name

    loop: Times
    tests: Annotated[Any, Under(lambda: (CampaignTestFile, TestLoopFile), many=True)]


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
    folder = tests.place.path.parent
    for element, turn in _turns(tests.elements(), _Turn(0, 1)):
        if not isinstance(element.value, dict):
            element.refuse("is no test", "write `- name: ...` with its keys below")
            continue
        for item in expand(element.completed_by(_defaults_of(element, defaults))):
            name = item.get("name")
            if name is not None and turn.number == 0 and str(name.value) in names:
                _add_duplicate(name, names[str(name.value)])
            elif name is not None:
                names[str(name.value)] = name
            read += _TestReader(item, folder, rig, turn).read()
        if len(read) > MAX_TESTS:
            element.refuse(f"makes more than {MAX_TESTS} tests", "loop or repeat less often", "")
            break
    return tuple(read)


class _Turn(NamedTuple):
    """The turn of a loop in which a test runs, counted from 0, and the number of turns."""

    number: int
    of: int


def _turns(elements: Iterable[Located], turn: _Turn) -> Iterator[tuple[Located, _Turn]]:
    """Yield every test of a list with its turn, those of a loop once for each of its turns."""
    for element in elements:
        if element.get("loop") is None and element.get("tests") is None:
            yield element, turn
            continue
        file = read_mapping(TestLoopFile, element)
        inner = elements_of(element.get("tests"), "write a list of tests: - name: ...")
        times = file.loop if file is not None else 1
        for number in range(times):
            yield from _turns(inner, _Turn(turn.number * times + number, turn.of * times))


def _defaults_of(test: Located, defaults: Located | None) -> Located | None:
    """Return the defaults of a test, without those that its own keys take the place of."""
    if defaults is not None and test.get("leak_test") is not None:
        return defaults.with_value({key: e for key, e in defaults.items() if key in KEYS})
    own = {key for key in _IN_PLACE_OF if test.get(key) is not None}
    if defaults is None or not own:
        return defaults
    dropped = {key for each in own for key in _IN_PLACE_OF[each]}
    return defaults.with_value({key: e for key, e in defaults.items() if key not in dropped})


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
    turn: _Turn

    def read(self) -> Iterator[CampaignTest]:
        file = read_mapping(CampaignTestFile, self.item)
        if self.item.get("leak_test") is not None:
            yield from self._leak_tests(file)
            return
        load = self._load()
        control = self._control()
        self._check_one_gain()
        seed = 0 if file is None else _seed_of(file)
        faults: tuple[Fault, ...] | None = None
        awaited = read_awaited(self.item.get("wait_for"), self.rig)
        own = read_own_figures(self.item.get("figures"), self.rig)
        repeats = file.repeats if file else 1
        for index in range(repeats):
            number = self.turn.number * repeats + index
            context = context_of(file.duration if file else None, seed + number, self.folder)
            until = self._until()
            item = self.item if until is None else self._lasting(until[1])
            if until is not None:
                context = context._replace(duration_s=until[1])
            motion = read_motion(item, context, self.rig, CampaignTestFile.model_fields)
            if faults is None:
                lasts_s = motion.duration_s if motion else file.duration if file else None
                faults = read_faults(self.item.get("faults"), lasts_s, self.rig)
                criteria = read_criteria(self.item.get("criteria"), own, motion, self.rig)
                limits = read_test_limits(self.item.get("limits"), own, motion, self.rig)
                quantity = motion.setpoint.quantity if motion else None
                changes = self._control_changes(control, lasts_s, quantity)
            if file is None or motion is None:
                continue
            setpoint = motion.setpoint
            self._check_closed_loop(file, setpoint)
            start = self._start_position(file, setpoint)
            if start is None:
                continue
            yield CampaignTest(
                name=self._name_of(file, number),
                test_name=file.name,
                duration_s=motion.duration_s,
                start_position_m=start,
                settle_s=file.settle,
                setpoint=setpoint,
                load=load,
                faults=faults,
                expect=file.expect or _expected(faults),
                repeat=number + 1,
                seed=seed + number,
                on_fault=file.on_fault,
                gain_V_per_m=file.position_gain,
                own_figures=own,
                criteria=criteria,
                limits=limits,
                wait_for=awaited,
                until=None if until is None else until[0],
                control=control,
                segment_ends=motion.ends,
                control_changes=changes,
            )

    def _leak_tests(self, file: CampaignTestFile | None) -> Iterator[CampaignTest]:
        """Yield a test that locks the cylinder, once for each repeat."""
        step = read_leak_test(self.item, self.rig)
        awaited = read_awaited(self.item.get("wait_for"), self.rig)
        if file is None or step is None or self.rig is None:
            return
        place, seed = place_of(self.rig), _seed_of(file)
        for index in range(file.repeats):
            number = self.turn.number * file.repeats + index
            yield CampaignTest(
                name=self._name_of(file, number),
                test_name=file.name,
                duration_s=LEAK_TEST_S,
                start_position_m=place.value,
                settle_s=file.settle,
                setpoint=place,
                load=None,
                faults=(),
                expect=file.expect or Verdict.HEALTHY,
                repeat=number + 1,
                seed=seed + number,
                wait_for=awaited,
                leak_test=step,
            )

    def _name_of(self, file: CampaignTestFile, number: int) -> str:
        """Return the name of the test's run with a number, from 0, of those of all its turns."""
        return file.name if file.repeats * self.turn.of == 1 else f"{file.name} #{number + 1}"

    def _until(self) -> tuple[Until, float] | None:
        """Return what ends the test and its longest duration, s; None if it has no `until`."""
        item = self.item.get("until")
        for key in ("duration", "cycles", "segments"):
            if item is not None and self.item.get(key) is not None:
                limit = f"is given beside a {key.rstrip('s')}, whose end it would be too"
                item.refuse(limit, "give one of both: `at_most` says how long the test may last")
                return None
        return read_until(item, self.rig)

    def _lasting(self, duration_s: float) -> Located:
        """Return the test with a duration, as if the file gave it."""
        item = self.item.find("until")
        return self.item.with_value({**self.item.value, "duration": item.with_value(duration_s)})

    def _check_closed_loop(self, file: CampaignTestFile, setpoint: Setpoint) -> None:
        if setpoint.quantity == "position":
            return
        limit = "needs a position loop, and this setpoint is the valve command itself"
        item = self.item.get("on_fault")
        if item is not None and file.on_fault == OnFault.TOLERATE:
            item.refuse(limit, "give the test another on_fault, or a setpoint in m")
        if file.position_gain is not None:
            self.item.refuse(limit, "leave it out, or give a setpoint in m", key="position_gain")

    def _check_one_gain(self) -> None:
        control, gain = self.item.get("control"), self.item.get("position_gain")
        if gain is not None and control is not None and control.get("gain") is not None:
            gain.refuse("is given beside a gain under control", "leave one of them out")

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

    def _control_changes(
        self, own: ControlSettings | None, lasts_s: float | None, quantity: str | None
    ) -> tuple[ControlFrom, ...]:
        first = own or (self.rig.control if self.rig else ControlSettings())
        return read_control_changes(self.item.get("control_changes"), first, lasts_s, quantity)

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


def _seed_of(file: CampaignTestFile) -> int:
    """Return a test's own seed, or one that follows from its name.

    So adding a test changes no other test's noise.
    """
    return zlib.crc32(str(file.name).encode()) >> 1 if file.seed is None else file.seed


def _expected(faults: tuple[Fault, ...]) -> Verdict:
    """Return the verdict that is right for these faults: healthy, the one kind, or multiple."""
    kinds = {fault.kind for fault in faults}
    if not kinds:
        return Verdict.HEALTHY
    return Verdict(kinds.pop()) if len(kinds) == 1 else Verdict.MULTIPLE
