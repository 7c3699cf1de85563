"""The `setpoint` of a test is read here and becomes a setpoint object of `control`.

If its levels are in metres it is a position setpoint (closed loop); if they are in volts it is the
valve command itself (open loop).
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Final, NamedTuple, TypeVar

from pydantic import create_model

from control import (
    Chirp,
    Constant,
    FromFile,
    Multisine,
    Pseudorandom,
    Quantity,
    RequestError,
    Setpoint,
    SetpointFileError,
    Sine,
    Steps,
    Trapezoid,
    Triangle,
)
from rig.configuration.reading import (
    Field,
    Interval,
    Is,
    Located,
    Physical,
    Place,
    QuantityError,
    Schema,
    WrongDimensionError,
    read_mapping,
    suggestion,
)

S = TypeVar("S")

DURATION: Final = Physical("s", 5.0, 3600.0, 40.0)
"""How long a test may last. Below 5 s no filter has settled; beyond an hour the rows of one test
would not fit beside others in memory, and `repeats` or a `loop` serve better."""
_HOLD: Final = Physical("s", 1e-3, 3600.0, 2.0)
_LEVELS: Final[tuple[tuple[Physical, Quantity], ...]] = (
    (Physical("m", -5.0, 5.0, 0.3), "position"),
    (Physical("V", -100.0, 100.0, 3.0), "command"),
)


class Level(NamedTuple):
    """A value of a setpoint: a "position" in metres, or a "command" of the valve in volts."""

    value: float
    quantity: Quantity


class LevelField(Field):
    """The annotation of a schema's `Level`, which a file gives in metres or in volts."""

    def parse(self, raw: object) -> Level:
        """Return the level: its SI value, and whether its unit makes it a position or a command.

        Raises:
            QuantityError: it is neither a length nor a voltage, or beyond +-5 m or +-100 V.
        """
        for physical, quantity in _LEVELS:
            try:
                return Level(physical.parse(raw), quantity)
            except WrongDimensionError:
                continue
        remedy = "write a position, such as 0.3 m, or a command, such as 3 V"
        raise QuantityError("is neither a length nor a voltage", remedy)

    def json_schema(self) -> dict[str, Any]:
        """Return a text with a unit."""
        choices = [physical.json_schema() for physical, _ in _LEVELS]
        return {"anyOf": choices, "description": "a position, such as 0.3 m, or a command in V"}


_ZERO: Final = Level(0.0, "position")
AnyLevel = Annotated[Level, LevelField()]
Frequency = Annotated[float, Physical("Hz", 1e-3, 500.0, 0.5)]
SweepEnd = Annotated[float, Physical("Hz", 0.0, 500.0, 1.0)]
Phase = Annotated[float, Physical("rad", -1e3, 1e3)]


class SetpointContext(NamedTuple):
    """The values of a test that its setpoint needs.

    Attributes:
        duration_s: duration of the test.
        seed: seed of the test, for pseudorandom setpoints without a seed of their own.
        folder: folder from which the paths of setpoint files are resolved.
        quantity: whether the setpoint is a position or a command.
    """

    duration_s: float
    seed: int
    folder: Path
    quantity: Quantity = "position"


class SetpointFile(Schema):
    """The key `type` that every setpoint has; a schema for each type adds the other keys."""

    type: str

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint that these values describe.

        Raises:
            RequestError: the values contradict each other.
        """
        raise NotImplementedError


class ConstantFile(SetpointFile):
    """Keys of a constant setpoint."""

    value: AnyLevel

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Constant` of the context's quantity."""
        return Constant(self.value.value, context.quantity)


class WaveFile(SetpointFile):
    """The keys that all waves around a mean have; the mean is zero unless it is given."""

    amplitude: AnyLevel
    frequency: Frequency
    mean: AnyLevel = _ZERO
    phase: Phase = 0.0


class SineFile(WaveFile):
    """Keys of a sine, whose mean is zero unless it is given."""

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Sine` of the context's quantity."""
        mean, amplitude = self.mean.value, self.amplitude.value
        return Sine(mean, amplitude, self.frequency, self.phase, context.quantity)


class TriangleFile(WaveFile):
    """Keys of a triangle wave, whose mean is zero unless it is given."""

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Triangle` of the context's quantity."""
        mean, amplitude = self.mean.value, self.amplitude.value
        return Triangle(mean, amplitude, self.frequency, self.phase, context.quantity)


class TrapezoidFile(SetpointFile):
    """Keys of a trapezoid wave, which rests for `hold` at each end."""

    amplitude: AnyLevel
    frequency: Frequency
    hold: Annotated[float, _HOLD]
    mean: AnyLevel = _ZERO
    phase: Phase = 0.0

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Trapezoid` of the context's quantity.

        Raises:
            SetpointError: the rests leave no time to move.
        """
        mean, amplitude = self.mean.value, self.amplitude.value
        return Trapezoid(mean, amplitude, self.frequency, self.hold, self.phase, context.quantity)


class ChirpFile(SetpointFile):
    """Keys of a chirp, which reaches `end_frequency` after `sweep_time`.

    Without the key `sweep_time` it reaches that frequency at the end of the test.
    """

    amplitude: AnyLevel
    start_frequency: SweepEnd
    end_frequency: SweepEnd
    sweep_time: Annotated[float | None, Physical("s", 0.1, 86400.0, 40.0)] = None
    mean: AnyLevel = _ZERO
    phase: Phase = 0.0

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Chirp` of the context's quantity; its frequency goes on changing to the end."""
        mean, amplitude, start = self.mean.value, self.amplitude.value, self.start_frequency
        rate = (self.end_frequency - start) / (self.sweep_time or context.duration_s)
        return Chirp(mean, amplitude, start, rate, self.phase, context.quantity)


class StepsFile(SetpointFile):
    """Keys of steps, which hold each level for `hold`, and the last one to the end."""

    levels: list[AnyLevel]
    hold: Annotated[float, _HOLD]

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Steps` of the context's quantity."""
        levels = tuple(level.value for level in self.levels)
        return Steps(levels, self.hold, context.quantity)


class PseudorandomFile(SetpointFile):
    """Keys of a pseudorandom setpoint, which uses the test's seed unless `seed` is given."""

    lower: AnyLevel
    upper: AnyLevel
    hold: Annotated[tuple[float, float], Interval(_HOLD, single=True)]
    seed: int | None = None

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Pseudorandom` of the context's quantity."""
        seed = context.seed if self.seed is None else self.seed
        lower, upper = self.lower.value, self.upper.value
        return Pseudorandom(lower, upper, *self.hold, seed, context.quantity)


class MultisineFile(SetpointFile):
    """Keys of a multisine, whose phases are Schroeder's, or random if a seed is given."""

    amplitude: AnyLevel
    frequencies: list[Frequency]
    mean: AnyLevel = _ZERO
    seed: int | None = None

    def build(self, context: SetpointContext) -> Setpoint:
        """Return a `Multisine` of the context's quantity."""
        mean, amplitude = self.mean.value, self.amplitude.value
        frequencies = tuple(self.frequencies)
        return Multisine(mean, amplitude, frequencies, self.seed, context.quantity)


class FromFileFile(SetpointFile):
    """Keys of a setpoint that is read from a CSV file."""

    path: str
    quantity: Quantity = "position"

    def build(self, context: SetpointContext) -> Setpoint:
        """Read the file, in `context.folder` unless its path is absolute, and return the setpoint.

        Its quantity is that of the file's key `quantity`, not that of the context.

        Raises:
            SetpointFileError: the file is missing or no setpoint file; it lists its problems.
        """
        return FromFile(context.folder / self.path, self.quantity)


SCHEMAS: Final[dict[str, type[SetpointFile]]] = {
    "constant": ConstantFile,
    "sine": SineFile,
    "triangle": TriangleFile,
    "trapezoid": TrapezoidFile,
    "chirp": ChirpFile,
    "steps": StepsFile,
    "pseudorandom": PseudorandomFile,
    "multisine": MultisineFile,
    "file": FromFileFile,
}


def setpoint_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of all setpoints, each with the type that it belongs to."""
    return typed_files(SCHEMAS)


def typed_files(schemas: Mapping[str, type[Schema]]) -> tuple[type[Schema], ...]:
    """Return classes of keys for an editor, each with the type that it belongs to.

    Args:
        schemas: type -> class of the keys.
    """
    return tuple(
        create_model(
            schema.__name__,
            __base__=schema,
            __doc__=schema.__doc__,
            type=(Annotated[Any, Is(kind)], ...),
        )
        for kind, schema in schemas.items()
    )


def schema_of(item: Located, schemas: Mapping[str, type[S]], what: str) -> type[S] | None:
    """Return the schema of the type that a mapping names.

    If it names no type, or an unknown one, record a problem and return None.

    Args:
        item: the mapping, with its type under the key `type`.
        schemas: type -> schema.
        what: what the mapping describes, for messages.
    """
    kind = item.get("type")
    if not isinstance(item.value, dict) or kind is None:
        item.refuse(f"is not a {what}", f"give its type: {', '.join(schemas)}")
        return None
    schema = schemas.get(str(kind.value))
    if schema is None:
        remedy = suggestion(str(kind.value), list(schemas), "types")
        kind.refuse(f"is not a known {what}", remedy)
    return schema


def read_setpoint(item: Located, context: SetpointContext) -> Setpoint | None:
    """Return the setpoint that a mapping describes; if it cannot be made, record why, return None.

    The levels' unit decides on the quantity, in place of the context's. A setpoint from a file is
    read at once.
    """
    problems = item.sources.problems
    before = problems.reported
    schema = schema_of(item, SCHEMAS, "setpoint")
    file = read_mapping(schema, item) if schema is not None else None
    quantity = _common_quantity(item) if schema is not None else None
    if file is None or problems.reported > before:
        return None
    if isinstance(file, FromFileFile):
        path = context.folder / file.path
        if item.sources.read_bytes(path, item.find("path")) is None:
            return None
    elif quantity is not None:
        context = context._replace(quantity=quantity)
    try:
        return file.build(context)
    except SetpointFileError as error:
        for problem in error.problems:
            csv, _, line = problem.where.rpartition(":")
            place = item.find("path").place
            if line.isdecimal():
                place = Place(Path(csv), int(line), 1)
            problems.add(place, problem.field, problem.value, problem.limit, problem.remedy)
    except RequestError as error:
        for problem in error.problems:
            key = str(problem.field).partition("[")[0].removesuffix("_hz").removesuffix("_s")
            item.find(key).refuse(problem.limit, problem.remedy, problem.value)
    return None


def _common_quantity(item: Located) -> Quantity | None:
    """Return the common quantity of a setpoint's levels; None if there are no levels.

    If some levels are positions and others commands, record a problem and return None.
    """
    found: dict[Quantity, str] = {}
    for key, entry in item.items():
        for level in entry.elements() or [entry]:
            with suppress(QuantityError):
                found.setdefault(LevelField().parse(level.value).quantity, key)
    check_unmixed(found, item)
    return next(iter(found)) if len(found) == 1 else None


def check_unmixed(found: Mapping[Quantity, str], item: Located) -> None:
    """Record a problem if a setpoint has levels both in metres and in volts.

    Args:
        found: each quantity that the levels have -> a key whose level has it.
        item: the setpoint.
    """
    if len(found) > 1:
        units = {"position": "metres", "command": "volts"}
        listing = ", ".join(f"{key} in {units[quantity]}" for quantity, key in found.items())
        remedy = "give all in metres (closed loop) or all in volts (open loop)"
        item.refuse("are mixed", remedy, listing)
