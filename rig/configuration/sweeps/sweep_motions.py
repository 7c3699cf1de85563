"""The `motions` of a sweep are setpoints like a campaign's, with quantities that may be drawn."""

from math import pi
from typing import Annotated, Any, Final

from control import Quantity
from rig.configuration.campaigns import Level, LevelField, check_unmixed
from rig.configuration.reading import (
    Located,
    Physical,
    Problems,
    Schema,
    quantity_in,
    read_mapping,
    show,
    shown,
    suggestion,
)
from rig.configuration.rigs import Limits
from rig.plant import Parameters

from .distributions import Distribution, Drawn, Random, resolved
from .sweep_plan import MotionType, SweptMotion

_AnyLevel = Annotated[Any, Random(LevelField())]
_AnyFrequency = Annotated[Any, Random(Physical("Hz", 1e-3, 100.0, 0.5))]
_AnySweepEnd = Annotated[Any, Random(Physical("Hz", 0.0, 100.0, 1.0))]
_AnyPhase = Annotated[Any, Random(Physical("rad", -1e3, 1e3))]
_AnyHold = Annotated[Any, Random(Physical("s", 1e-3, 3600.0, 2.0))]
_MOST_SINES: Final = 32
_MOST_LEVELS: Final = 1000


class MotionFile(Schema):
    """Keys that every motion of a sweep has; its type decides on the other keys."""

    type: str
    name: str | None = None
    share: Annotated[float, Physical("", 1e-6, 1e6, 1.0)] = 1.0


class SweptConstantFile(MotionFile):
    """Keys of a constant setpoint."""

    value: _AnyLevel


class SweptSineFile(MotionFile):
    """Keys of a sine, whose phase is drawn from 0 to 2 pi unless it is given."""

    amplitude: _AnyLevel
    frequency: _AnyFrequency
    mean: _AnyLevel = None
    phase: _AnyPhase = None


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
    frequencies: Any
    count: int | None = None
    mean: _AnyLevel = None


class SweptStepsFile(MotionFile):
    """Keys of steps, which hold each level for `hold`, and the last one to the end."""

    levels: Any
    hold: _AnyHold


class SweptPseudorandomFile(MotionFile):
    """Keys of a pseudorandom setpoint, whose sequence differs from case to case."""

    lower: _AnyLevel
    upper: _AnyLevel
    hold_min: _AnyHold
    hold_max: _AnyHold


SCHEMAS: Final[dict[MotionType, type[MotionFile]]] = {
    "constant": SweptConstantFile,
    "sine": SweptSineFile,
    "chirp": SweptChirpFile,
    "multisine": SweptMultisineFile,
    "steps": SweptStepsFile,
    "pseudorandom": SweptPseudorandomFile,
}
_LISTS: Final = {
    "frequencies": (Random(Physical("Hz", 1e-3, 100.0, 0.5)), _MOST_SINES),
    "levels": (Random(LevelField()), _MOST_LEVELS),
}
_ANY_PHASE: Final = Distribution("uniform", (0.0, 2.0 * pi))
_NOTHING: Final = Distribution("fixed", (0.0,))


def read_motions(
    item: Located, limits: Limits | None, plant: Parameters | None, problems: Problems
) -> tuple[SweptMotion, ...]:
    """Return the motions of a sweep that can be made; record all problems.

    A motion that may go beyond the limits is returned, with a problem. Of motions with the same
    name the last is returned.

    Args:
        item: the list under the key `motions`.
        limits: limits of the rig, within which motions must stay; None if they are not known.
        plant: parameters of the rig's plant.
        problems: takes the mistakes.
    """
    if not item.elements():
        remedy = "write at least one: `- {type: sine, ...}`"
        problems.add(item.place, "motions", shown(item), "is not a list of motions", remedy)
    found: dict[str, SweptMotion] = {}
    for element in item.elements():
        motion = _Reader(element, limits, plant, problems).read()
        if motion is None:
            continue
        if motion.name in found:
            remedy = "give one of them another `name`"
            problems.add(element.place, "name", motion.name, "is given twice", remedy)
        found[motion.name] = motion
    return tuple(found.values())


class _Reader:
    """A reader of one motion."""

    def __init__(
        self, item: Located, limits: Limits | None, plant: Parameters | None, problems: Problems
    ) -> None:
        self._item, self._limits, self._plant, self._problems = item, limits, plant, problems
        self._quantities: dict[Quantity, str] = {}

    def read(self) -> SweptMotion | None:
        item, problems = self._item, self._problems
        kind = item.get("type")
        if not isinstance(item.value, dict) or kind is None:
            remedy = f"give its type: {', '.join(SCHEMAS)}"
            problems.add(item.place, item.name, shown(item), "is not a motion", remedy)
            return None
        known = next((name for name in SCHEMAS if name == kind.value), None)
        if known is None:
            remedy = suggestion(str(kind.value), list(SCHEMAS), "types")
            problems.add(kind.place, "type", shown(kind), "is not a known motion", remedy)
            return None
        before = problems.reported
        file = read_mapping(SCHEMAS[known], item, problems)
        if file is None:
            return None
        values = {
            key: drawn
            for key in type(file).model_fields
            if key not in MotionFile.model_fields and key != "count"
            if (drawn := self._values(key, file)) is not None
        }
        quantity = self._quantity()
        if problems.reported > before:
            return None
        if known in ("sine", "chirp", "multisine"):
            values.setdefault("mean", (_NOTHING,))
        if known in ("sine", "chirp"):
            values.setdefault("phase", (_ANY_PHASE,))
        motion = SweptMotion(file.name or known, known, file.share, quantity, values)
        self._check_order(motion)
        self._check_reach(motion)
        return motion

    def _values(self, key: str, file: MotionFile) -> tuple[Distribution, ...] | None:
        given = getattr(file, key)
        if given is None:
            return None
        if isinstance(given, Drawn):
            return (self._one(key, given),)
        return self._list(key, getattr(file, "count", None))

    def _list(self, key: str, count: int | None) -> tuple[Distribution, ...] | None:
        """Return a distribution for each element of a list, or `count` copies of a single one.

        If any is wrong, or there are too many, problems are recorded and None is returned.
        """
        reader, most = _LISTS[key]
        entry = self._item.find((key,))
        elements = entry.elements() or [entry] * (count or 1)
        if not 1 <= len(elements) <= most:
            limit = f"has {len(elements)} elements"
            self._problems.add(entry.place, key, "", limit, f"give 1 to {most}")
            return None
        read = [self._element(key, reader, element) for element in elements]
        found = tuple(each for each in read if each is not None)
        return found if len(found) == len(elements) else None

    def _element(self, key: str, reader: Random, element: Located) -> Distribution | None:
        read = reader.parse
        return quantity_in(element, lambda: self._one(key, read(element.plain())), self._problems)

    def _one(self, key: str, drawn: Drawn) -> Distribution:
        for value in drawn.values:
            if isinstance(value, Level):
                self._quantities.setdefault(value.quantity, key)
        if not isinstance(drawn.values[0], Level):
            return resolved(drawn, limits=_physical(key))
        limits = self._level_limits(drawn.values[0].quantity)
        return resolved(drawn, limits=limits)

    def _level_limits(self, quantity: Quantity) -> Physical | None:
        """Return the rig's limits for levels of a quantity; None if they are not known."""
        if self._limits is None:
            return None
        if quantity == "position":
            return Physical("m", self._limits.position_min_m, self._limits.position_max_m)
        return Physical("V", -self._limits.command_V, self._limits.command_V)

    def _quantity(self) -> Quantity:
        check_unmixed(self._quantities, self._item, self._problems)
        return next(iter(self._quantities), "position")

    def _check_order(self, motion: SweptMotion) -> None:
        for smaller, larger in (("lower", "upper"), ("hold_min", "hold_max")):
            if smaller not in motion.values or larger not in motion.values:
                continue
            most = motion.values[smaller][0].support[1]
            least = motion.values[larger][0].support[0]
            if most > least:
                entry = self._item.find((larger,))
                remedy = "keep their ranges apart"
                self._problems.add(
                    entry.place, larger, shown(entry), f"may be below {smaller}", remedy
                )

    def _check_reach(self, motion: SweptMotion) -> None:
        """Record a problem if a motion may go beyond the rig's limits."""
        if self._limits is None:
            return
        low, high = reach(motion)
        unit, lower, upper = "m", self._limits.position_min_m, self._limits.position_max_m
        if motion.quantity == "command":
            unit, lower, upper = "V", -self._limits.command_V, self._limits.command_V
        if low >= lower and high <= upper:
            return
        above = high > upper
        value = f"may come to {show(high if above else low, unit)}"
        limit = f"{'above' if above else 'below'} the rig's {show(upper if above else lower, unit)}"
        self._problems.add(
            self._item.place, motion.name, value, limit, "reduce or shift the motion"
        )


def _physical(key: str) -> Physical | None:
    readers = {"hold": _AnyHold, "hold_min": _AnyHold, "hold_max": _AnyHold,
               "frequency": _AnyFrequency, "frequencies": _AnyFrequency, "phase": _AnyPhase,
               "start_frequency": _AnySweepEnd, "end_frequency": _AnySweepEnd}  # fmt: skip
    reader = readers.get(key)
    inner = reader.__metadata__[0].inner if reader is not None else None
    return inner if isinstance(inner, Physical) else None


def reach(motion: SweptMotion) -> tuple[float, float]:
    """Return bounds of the setpoints that a motion may reach: lowest and highest, m or V.

    They hold for every value that its distributions allow.
    """
    values = motion.values
    if "amplitude" in values:
        low, high = values["mean"][0].support
        least, most = values["amplitude"][0].support
        half = max(abs(least), abs(most))
        return low - half, high + half
    keys = ("value", "levels", "lower", "upper")
    held = [each.support for key in keys for each in values.get(key, ())]
    return min(low for low, _ in held), max(high for _, high in held)
