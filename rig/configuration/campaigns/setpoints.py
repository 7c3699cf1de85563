"""The `setpoint` of a test: its kind and values with units, to a setpoint of `control`.

Values in metres make it a position setpoint (closed loop), values in volts a command (open loop).
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
    """Annotates a `Level` of a schema: read in metres or volts, whichever the unit says."""

    def parse(self, raw: object) -> Level:
        """Return the level, and what its unit says it is.

        Raises:
            QuantityError: neither metres nor volts, or beyond what either may be.
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
    """What a setpoint takes from its test: duration in s, seed, and the folder paths count from."""

    duration_s: float
    seed: int
    folder: Path
    quantity: Quantity = "position"


class SetpointFile(Schema):
    """Keys of any setpoint; the others depend on the type."""

    type: str

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint.

        Raises:
            RequestError: its values contradict each other.
        """
        raise NotImplementedError


class ConstantFile(SetpointFile):
    """Keys of a constant setpoint."""

    value: AnyLevel

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        return Constant(self.value.value, context.quantity)


class SineFile(SetpointFile):
    """Keys of a sine; the mean is zero unless given."""

    amplitude: AnyLevel
    frequency: Frequency
    mean: AnyLevel | None = None
    phase: Phase = 0.0

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        mean, amplitude = _value(self.mean), self.amplitude.value
        return Sine(mean, amplitude, self.frequency, self.phase, context.quantity)


class ChirpFile(SetpointFile):
    """Keys of a chirp, which reaches its end frequency after `sweep_time`, else with the test."""

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
    """Keys of steps; the last level stays."""

    levels: list[AnyLevel]
    hold: Annotated[float, _HOLD]

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint."""
        levels = tuple(level.value for level in self.levels)
        return Steps(levels, self.hold, context.quantity)


class PseudorandomFile(SetpointFile):
    """Keys of a pseudorandom setpoint; without a seed of its own it takes the test's."""

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
    """Keys of a multisine; without a seed its phases are Schroeder's."""

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
    """Keys of a setpoint read from a CSV file."""

    path: str
    quantity: Quantity = "position"

    def build(self, context: SetpointContext) -> Setpoint:
        """Return the setpoint, the file read."""
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
    """Return the setpoint of a mapping; None, with problems, where it cannot be made."""
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
    """Return the quantity of all levels of a setpoint; None if it has none, or a mixture."""
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
    """Note a setpoint with levels in metres and in volts.

    Args:
        found: quantity -> a key whose level is given in it.
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
