"""The `motions` of a sweep are setpoints like a campaign's, with quantities that may be drawn."""

from dataclasses import replace
from math import pi
from typing import Annotated, Any, Final, NamedTuple, cast

from control import ControlSettings, Quantity
from rig.configuration.campaigns import Level, LevelField, check_unmixed, schema_of, typed_files
from rig.configuration.reading import Located, Physical, Schema, quantity_in, read_mapping, show
from rig.configuration.rigs import Limits, Rig, read_control
from rig.plant import TICK

from .distributions import Distribution, Drawn, Random, resolved
from .drawn_fields import DrawnList
from .motion_keys import HINTS, EveryMotionFile
from .sweep_plan import MotionType, SweptMotion
from .swept_asked import Asking
from .swept_segments import SweptSegmentsFile, read_sequence

_LEVEL: Final = Random(LevelField())
_FREQUENCY: Final = Random(Physical("Hz", 1e-3, 100.0, 0.5))
_AnyLevel = Annotated[Any, _LEVEL]
_AnyFrequency = Annotated[Any, _FREQUENCY]
_AnySweepEnd = Annotated[Any, Random(Physical("Hz", 0.0, 100.0, 1.0))]
_AnyPhase = Annotated[Any, Random(Physical("rad", -1e3, 1e3))]
_AnyHold = Annotated[Any, Random(Physical("s", 1e-3, 3600.0, 2.0))]
_MOST_SINES: Final = 32
_MOST_LEVELS: Final = 1000


class MotionFile(EveryMotionFile):
    """Keys of a motion with one setpoint, whose type decides on the other keys."""

    type: str


class SweptConstantFile(MotionFile):
    """Keys of a constant setpoint."""

    value: _AnyLevel


class SweptSineFile(MotionFile):
    """Keys of a sine, whose phase is drawn from 0 to 2 pi unless it is given."""

    amplitude: _AnyLevel
    frequency: _AnyFrequency
    mean: _AnyLevel = None
    phase: _AnyPhase = None


class SweptTriangleFile(SweptSineFile):
    """Keys of a triangle wave, which are those of a sine."""


class SweptTrapezoidFile(SweptSineFile):
    """Keys of a trapezoid wave, which rests for `hold` at each end."""

    hold: _AnyHold


class SweptChirpFile(MotionFile):
    """Keys of a chirp, which reaches its end frequency at the end of the case."""

    amplitude: _AnyLevel
    start_frequency: _AnySweepEnd
    end_frequency: _AnySweepEnd
    mean: _AnyLevel = None
    phase: _AnyPhase = None


class SweptMultisineFile(MotionFile):
    """Keys of a multisine, whose phases are drawn for each case."""

    amplitude: _AnyLevel
    frequencies: Annotated[Any, DrawnList(_FREQUENCY)]
    count: int | None = None
    mean: _AnyLevel = None


class SweptStepsFile(MotionFile):
    """Keys of steps, which hold each level for `hold`, and the last one to the end."""

    levels: Annotated[Any, DrawnList(_LEVEL)]
    hold: _AnyHold


class SweptPseudorandomFile(MotionFile):
    """Keys of a pseudorandom setpoint, whose sequence differs from case to case."""

    lower: _AnyLevel
    upper: _AnyLevel
    hold_min: _AnyHold
    hold_max: _AnyHold


SCHEMAS: Final[dict[str, type[MotionFile]]] = {
    "constant": SweptConstantFile,
    "sine": SweptSineFile,
    "triangle": SweptTriangleFile,
    "trapezoid": SweptTrapezoidFile,
    "chirp": SweptChirpFile,
    "multisine": SweptMultisineFile,
    "steps": SweptStepsFile,
    "pseudorandom": SweptPseudorandomFile,
}


def motion_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of all motions, each with the type that it belongs to."""
    return (*typed_files(SCHEMAS), SweptSegmentsFile)


_OF_EVERY_MOTION: Final = (*("type", "name", "share", "control", "segments", "criteria", "limits"),)
_LISTS: Final = {"frequencies": (_FREQUENCY, _MOST_SINES), "levels": (_LEVEL, _MOST_LEVELS)}
_ANY_PHASE: Final = Distribution("uniform", (0.0, 2.0 * pi))
_NOTHING: Final = Distribution("fixed", (0.0,))


class MotionContext(NamedTuple):
    """What the motions of a sweep need to know of it.

    Attributes:
        rig: its rig, within whose limits motions must stay; None if it is unusable.
        control: its control settings, of which a motion replaces those that it gives itself; None
            if they are not known.
        duration_s: duration of a case, s.
        seed: its seed.
        asking: what it asks of its cases.
    """

    rig: Rig | None
    control: ControlSettings | None
    duration_s: float
    seed: int
    asking: Asking


def read_motions(item: Located | None, context: MotionContext) -> tuple[SweptMotion, ...]:
    """Return the motions of a sweep that can be made; record all problems.

    A motion that may go beyond the limits is returned, with a problem. Of motions with the same
    name the last is returned.

    Args:
        item: the list under the key `motions`; None if it is missing.
        context: what they need to know of the sweep.
    """
    if item is None:
        return ()
    if not item.elements():
        item.refuse("is not a list of motions", "write at least one: `- {type: sine, ...}`")
    found: dict[str, SweptMotion] = {}
    for element in item.elements():
        motion = _Reader(element, context).read()
        if motion is None:
            # What it asks is checked all the same, so that all mistakes are told at once.
            context.asking.of_motion(element, None)
            continue
        criteria, limits = context.asking.of_motion(element, motion)
        motion = replace(motion, criteria=criteria, limits=limits)
        if motion.name in found:
            remedy = "give one of them another `name`"
            element.refuse("is given twice", remedy, motion.name, name="name")
        found[motion.name] = motion
    return tuple(found.values())


class _Reader:
    """A reader of one motion of a sweep, whose `read` returns it; None if it cannot be made.

    Problems are recorded. A motion that may go beyond the limits is returned all the same.
    """

    def __init__(self, item: Located, context: MotionContext) -> None:
        self._item, self._context = item, context
        self._limits: Limits | None = None if context.rig is None else context.rig.limits
        self._quantities: dict[Quantity, str] = {}

    def read(self) -> SweptMotion | None:
        problems = self._item.sources.problems
        before = problems.reported
        segmented = self._item.get("segments") is not None
        schema: type[EveryMotionFile] | None = SweptSegmentsFile
        if not segmented:
            schema = schema_of(self._item, SCHEMAS, "motion")
        file = read_mapping(schema, self._item, HINTS) if schema is not None else None
        own = self._item.get("control")
        control = None if own is None else read_control(own, self._context.control)
        if file is None:
            return None
        sequence = None
        if segmented:
            context = self._context
            sequence = read_sequence(self._item, context.rig, context.seed, context.duration_s)
            if sequence is None:
                return None
            self._quantities[sequence.quantity] = "segments"
        values = {
            key: drawn
            for key, field in type(file).model_fields.items()
            if key not in _OF_EVERY_MOTION and key != "count"
            if (drawn := self._values(key, field.metadata, file)) is not None
        }
        check_unmixed(self._quantities, self._item)
        quantity: Quantity = next(iter(self._quantities), "position")
        self._check_gain(quantity)
        if problems.reported > before:
            return None
        kind: MotionType = "segments"
        if isinstance(file, MotionFile):
            kind = cast(MotionType, file.type)
        if kind in ("sine", "triangle", "trapezoid", "chirp", "multisine"):
            values.setdefault("mean", (_NOTHING,))
        if kind in ("sine", "triangle", "trapezoid", "chirp"):
            values.setdefault("phase", (_ANY_PHASE,))
        motion = SweptMotion(
            file.name or kind, kind, file.share, quantity, values, control, sequence
        )
        self._check_order(motion)
        if self._limits is not None and sequence is None:
            self._check_reach(motion, self._limits.of(quantity))
        return motion

    def _values(
        self, key: str, readers: list[Any], file: EveryMotionFile
    ) -> tuple[Distribution, ...] | None:
        """Return the distributions of a key's value; None if the file does not give the key.

        A list (`levels`, `frequencies`) has one for each element; a single value in its place has
        `count` copies. Any other key has one. If an element is wrong, or there are too many, record
        problems and return None.
        """
        given = getattr(file, key)
        if given is None:
            return None
        entry = self._item.find(key)
        if isinstance(given, Drawn):
            one = quantity_in(entry, lambda: self._one(key, given, readers[0]))
            return None if one is None else (one,)
        reader, most = _LISTS[key]
        elements = entry.elements() or [entry] * (getattr(file, "count", None) or 1)
        if not 1 <= len(elements) <= most:
            entry.refuse(f"has {len(elements)} elements", f"give 1 to {most}", "")
            return None
        read = [self._element(key, reader, element) for element in elements]
        found = tuple(each for each in read if each is not None)
        return found if len(found) == len(elements) else None

    def _element(self, key: str, reader: Random, element: Located) -> Distribution | None:
        parse = reader.parse
        return quantity_in(element, lambda: self._one(key, parse(element.plain()), reader))

    def _one(self, key: str, drawn: Drawn, reader: Random) -> Distribution:
        for value in drawn.values:
            if isinstance(value, Level):
                self._quantities.setdefault(value.quantity, key)
        limits = reader.inner if isinstance(reader.inner, Physical) else Physical("")
        first = drawn.values[0]
        if isinstance(first, Level) and self._limits is not None:
            limits = self._limits.of(first.quantity)
        return resolved(drawn, limits)

    def _check_gain(self, quantity: Quantity) -> None:
        """Record a problem if a gain is given twice, or where there is no position loop."""
        if self._item.get("position_gain") is None:
            return
        own = self._item.get("control")
        if own is not None and isinstance(own.value, dict) and "gain" in own.value:
            limit = "is given beside a gain under control"
            self._item.refuse(limit, "leave one of them out", key="position_gain")
        if quantity == "command":
            limit = "needs a position loop, and this setpoint is the valve command itself"
            remedy = "leave it out, or give a setpoint in m"
            self._item.refuse(limit, remedy, key="position_gain")

    def _check_order(self, motion: SweptMotion) -> None:
        for smaller, larger in (("lower", "upper"), ("hold_min", "hold_max")):
            if smaller not in motion.values or larger not in motion.values:
                continue
            most = motion.values[smaller][0].support[1]
            least = motion.values[larger][0].support[0]
            if most > least:
                self._item.refuse(f"may be below {smaller}", "keep their ranges apart", key=larger)
        if motion.type == "trapezoid":
            self._check_rests(motion)

    def _check_rests(self, motion: SweptMotion) -> None:
        """Record a problem if the rests of a trapezoid may leave no time to move."""
        half = 0.5 / motion.values["frequency"][0].support[1]
        longest = motion.values["hold"][0].support[1]
        if half - longest < TICK:
            limit = f"may leave no time to move in half a period of {show(half, 's')}"
            remedy = "rest for less, or move more slowly"
            self._item.refuse(limit, remedy, show(longest, "s"), key="hold")

    def _check_reach(self, motion: SweptMotion, limits: Physical) -> None:
        """Record a problem if a motion may go beyond the rig's limits."""
        low, high = reach(motion)
        if low >= limits.lower and high <= limits.upper:
            return
        above = high > limits.upper
        end = show(limits.upper if above else limits.lower, limits.unit)
        limit = f"{'above' if above else 'below'} the rig's {end}"
        value = f"may come to {show(high if above else low, limits.unit)}"
        self._item.refuse(limit, "reduce or shift the motion", value, name=motion.name)


def reach(motion: SweptMotion) -> tuple[float, float]:
    """Return a lower and an upper bound, in m or V, of a motion's setpoints in all cases."""
    values = motion.values
    if "amplitude" in values:
        low, high = values["mean"][0].support
        least, most = values["amplitude"][0].support
        half = max(abs(least), abs(most))
        return low - half, high + half
    keys = ("value", "levels", "lower", "upper")
    held = [each.support for key in keys for each in values.get(key, ())]
    return min(low for low, _ in held), max(high for _, high in held)
