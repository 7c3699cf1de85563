"""The `setpoint` of a test is read here and becomes a setpoint object of `control`.

If its levels are in metres it is a position setpoint (closed loop); if they are in volts it is the
valve command itself (open loop).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, NamedTuple

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
)
from rig.configuration.reading import (
    Field,
    Interval,
    Located,
    Physical,
    Place,
    Problems,
    QuantityError,
    Schema,
    Sources,
    WrongDimensionError,
    read_mapping,
    shown,
    suggestion,
)

_HOLD: Final = Physical("s", 1e-3, 3600.0, 2.0)
_LEVELS: Final[tuple[tuple[Physical, Quantity], ...]] = (
    (Physical("m", -5.0, 5.0, 0.3), "position"),
    (Physical("V", -100.0, 100.0, 3.0), "command"),
)


class Level(NamedTuple):
    """A value of a setpoint: metres of quantity "position", or volts of quantity "command"."""

    value: float
    quantity: Quantity


class LevelField(Field):
    """The annotation of a schema's `Level`, which a file gives in metres or in volts."""

    def parse(self, raw: object) -> Level:
        """Return the level: its SI value, and whether its unit makes it a position or a command.

        Raises:
            QuantityError: it is neither a length nor a voltage, or outside the limits of that.
        """
        for physical, quantity in _LEVELS:
            try:
                return Level(physical.parse(raw), quantity)
            except WrongDimensionError:
                continue
        remedy = "write a position, such as 0.3 m, or a command, such as 3 V"
        raise QuantityError("is neither a length nor a voltage", remedy)


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
    """The key that every setpoint has; its type decides on the other keys."""

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
        """Return the setpoint."""
        return Constant(self.value.value, context.quantity)


class SineFile(SetpointFile):
    """Keys of a sine, whose mean is zero unless it is given."""

    amplitude: AnyLevel
    frequency: Frequency
    mean: AnyLevel | None = None
    phase: Phase = 0.0

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        mean, amplitude = _value(self.mean), self.amplitude.value
        return Sine(mean, amplitude, self.frequency, self.phase, context.quantity)


class ChirpFile(SetpointFile):
    """Keys of a chirp, which reaches its end frequency after `sweep_time`.

    Without that key it reaches it at the end of the test.
    """

    amplitude: AnyLevel
    start_frequency: SweepEnd
    end_frequency: SweepEnd
    sweep_time: Annotated[float | None, Physical("s", 0.1, 86400.0, 40.0)] = None
    mean: AnyLevel | None = None
    phase: Phase = 0.0

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        sweep = self.end_frequency - self.start_frequency
        return Chirp(
            _value(self.mean),
            self.amplitude.value,
            self.start_frequency,
            sweep / (self.sweep_time or context.duration_s),
            self.phase,
            context.quantity,
        )


class StepsFile(SetpointFile):
    """Keys of steps, which hold each level for `hold`, and the last one to the end."""

    levels: list[AnyLevel]
    hold: Annotated[float, _HOLD]

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        levels = tuple(level.value for level in self.levels)
        return Steps(levels, self.hold, context.quantity)


class PseudorandomFile(SetpointFile):
    """Keys of a pseudorandom setpoint, which uses the test's seed unless it gives one."""

    lower: AnyLevel
    upper: AnyLevel
    hold: Annotated[tuple[float, float], Interval(_HOLD, single=True)]
    seed: int | None = None

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        seed = context.seed if self.seed is None else self.seed
        lower, upper = self.lower.value, self.upper.value
        return Pseudorandom(lower, upper, *self.hold, seed, context.quantity)


class MultisineFile(SetpointFile):
    """Keys of a multisine, whose phases are Schroeder's, or random if a seed is given."""

    amplitude: AnyLevel
    frequencies: list[Frequency]
    mean: AnyLevel | None = None
    seed: int | None = None

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        mean, amplitude = _value(self.mean), self.amplitude.value
        frequencies = tuple(self.frequencies)
        return Multisine(mean, amplitude, frequencies, self.seed, context.quantity)


class FromFileFile(SetpointFile):
    """Keys of a setpoint that is read from a CSV file."""

    path: str
    quantity: Quantity = "position"

    def build(self, context: SetpointContext) -> Setpoint:
        """Read the file and return the setpoint.

        Raises:
            SetpointFileError: the file is no setpoint; it lists every problem.
        """
        return FromFile(context.folder / self.path, self.quantity)


SCHEMAS: Final[dict[str, type[SetpointFile]]] = {
    "constant": ConstantFile,
    "sine": SineFile,
    "chirp": ChirpFile,
    "steps": StepsFile,
    "pseudorandom": PseudorandomFile,
    "multisine": MultisineFile,
    "file": FromFileFile,
}


def _value(level: Level | None) -> float:
    return 0.0 if level is None else level.value


def read_setpoint(item: Located, context: SetpointContext, sources: Sources) -> Setpoint | None:
    """Return the setpoint that a mapping describes; None if it cannot be made.

    The problems are then added to those of `sources`.
    """
    kind = item.get("type")
    problems = sources.problems
    if not isinstance(item.value, dict) or kind is None:
        remedy = f"give its type: {', '.join(SCHEMAS)}"
        problems.add(item.place, item.name, shown(item), "is not a setpoint", remedy)
        return None
    schema = SCHEMAS.get(str(kind.value))
    if schema is None:
        remedy = suggestion(str(kind.value), list(SCHEMAS), "types")
        problems.add(kind.place, "type", shown(kind), "is not a known setpoint", remedy)
        return None
    before = problems.reported
    file = read_mapping(schema, item, problems)
    quantity = _common_quantity(item, sources)
    if file is None or problems.reported > before:
        return None
    if isinstance(file, FromFileFile):
        if sources.read_bytes(context.folder / file.path, item.find(("path",))) is None:
            return None
    elif quantity is not None:
        context = context._replace(quantity=quantity)
    try:
        return file.build(context)
    except SetpointFileError as error:
        _add_file_problems(error, item, sources)
    except RequestError as error:
        for problem in error.problems:
            key = str(problem.field).partition("[")[0].removesuffix("_hz").removesuffix("_s")
            found = item.find((key,))
            problems.add(found.place, found.name, problem.value, problem.limit, problem.remedy)
    return None


def _common_quantity(item: Located, sources: Sources) -> Quantity | None:
    """Return the common quantity of a setpoint's levels; None if there are no levels.

    If some levels are positions and others commands, record a problem and return None.
    """
    found: dict[Quantity, str] = {}
    for key, entry in item.items():
        for level in entry.elements() or [entry]:
            try:
                quantity = LevelField().parse(level.value).quantity
            except QuantityError:
                continue
            found.setdefault(quantity, key)
    check_unmixed(found, item, sources.problems)
    return next(iter(found)) if len(found) == 1 else None


def check_unmixed(found: Mapping[Quantity, str], item: Located, problems: Problems) -> None:
    """Record a problem if a setpoint has levels both in metres and in volts.

    Args:
        found: each quantity that the levels have -> a key whose level has it.
        item: the setpoint.
        problems: takes the mistake.
    """
    if len(found) > 1:
        units = {"position": "metres", "command": "volts"}
        listing = ", ".join(f"{key} in {units[quantity]}" for quantity, key in found.items())
        remedy = "give all in metres (closed loop) or all in volts (open loop)"
        problems.add(item.place, item.name, listing, "are mixed", remedy)


def _add_file_problems(error: SetpointFileError, item: Located, sources: Sources) -> None:
    entry = item.find(("path",))
    for problem in error.problems:
        path, _, line = problem.where.rpartition(":")
        place = Place(Path(path), int(line), 1) if line.isdecimal() else entry.place
        sources.problems.add(place, problem.field, problem.value, problem.limit, problem.remedy)
