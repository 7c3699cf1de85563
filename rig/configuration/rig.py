"""Rig files: what a rig is made of, what it can measure and inject, and what it must not exceed."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args, get_type_hints

from pydantic import create_model

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from faults.bypass import BypassValve
from rig.plant.model import Model
from rig.plant.sensors import DATA_SHEET, SensorParameters

from .document import Located, Sources
from .fields import Interval, Physical
from .lookup import reference_in, resolve
from .model import override, read_model
from .quantities import show
from .validation import Schema, check, shown
from .valves import ReturnValve, read_bypass_valves, read_return_valve

Pace = Literal["real", "fast"]


@dataclass(frozen=True)
class Limits:
    """What a test may ask of a rig: position, command of either sign, chamber pressure."""

    position_min_m: float
    position_max_m: float
    command_V: float  # noqa: N815
    pressure_max_Pa: float  # noqa: N815


@dataclass(frozen=True)
class Rig:
    """A rig as its file describes it.

    Attributes:
        plant: the truth of a simulated rig, not what a detector knows of it.
        bypass_valves: the valves that make leaks, by the kind of fault each makes.
        return_valve: the valve that blocks the return line, if there is one.
        gain_V_per_m: gain of the proportional position loop.
        pace: whether its campaigns run at the wall clock or as fast as they can, unless told.
    """

    name: str
    description: str
    backend: Literal["simulated"]
    plant: Model
    sensors: SensorParameters
    has_supply_pressure_sensor: bool
    has_load_cell: bool
    has_spool_sensor: bool
    bypass_valves: Mapping[str, BypassValve]
    return_valve: ReturnValve | None
    limits: Limits
    gain_V_per_m: float  # noqa: N815
    pace: Pace


class RigFile(Schema):
    """Keys of a rig file; nested mappings have their own schemas."""

    name: str
    description: str = ""
    parent: str | None = None
    backend: Literal["simulated"] = "simulated"
    plant: Any
    sensors: Any = None
    supply_pressure_sensor: bool = False
    load_cell: bool = False
    spool_sensor: bool = False
    bypass_valves: Any = None
    return_valve: Any = None
    limits: Any
    position_gain: Annotated[float, Physical("V/m", 0.1, 1e4, POSITION_GAIN)] = POSITION_GAIN
    pace: Pace = "fast"


class PlantFile(Schema):
    """Keys of a rig's plant: a model, and in what the rig differs from it."""

    model: str
    parameters: Any = None
    friction_law: Literal["bristle", "karnopp"] | None = None
    effects: Any = None


class LimitsFile(Schema):
    """Keys of a rig's limits."""

    position: Annotated[tuple[float, float], Interval(Physical("m", -1.0, 6.0, 0.3))]
    command: Annotated[float, Physical("V", 0.1, 100.0, COMMAND_LIMIT)] = COMMAND_LIMIT
    pressure: Annotated[float, Physical("Pa", 1e6, 1e8, 2e7)]


def _sensors_schema() -> type[Schema]:
    fields: dict[str, Any] = {}
    for name, hint in get_type_hints(SensorParameters, include_extras=True).items():
        quantity, usual = get_args(hint)[1], getattr(DATA_SHEET, name)
        limits = Physical(quantity.unit, quantity.lower, quantity.upper, usual or None)
        fields[name] = (Annotated[float, limits], usual)
    return create_model("SensorsFile", __base__=Schema, **fields)


_SENSORS_SCHEMA: Final = _sensors_schema()


def read_rig(path: Path, sources: Sources) -> Rig | None:
    """Return the rig in a file; None, with problems added to the sources', if it cannot be made."""
    root = _with_parents(path, sources, ())
    if root is None:
        return None
    file = check(RigFile, root, sources.problems)
    plant = _read_plant(root, sources)
    sensors = _read_sensors(root, sources)
    bypass_valves = read_bypass_valves(root.get("bypass_valves"), sources.problems)
    return_valve = read_return_valve(root.get("return_valve"), sources.problems)
    limits = _read_limits(root, plant, sources)
    if file is None or plant is None or sensors is None or limits is None:
        return None
    return Rig(
        name=file.name,
        description=file.description.strip(),
        backend=file.backend,
        plant=plant,
        sensors=sensors,
        has_supply_pressure_sensor=file.supply_pressure_sensor,
        has_load_cell=file.load_cell,
        has_spool_sensor=file.spool_sensor,
        bypass_valves=bypass_valves,
        return_valve=return_valve,
        limits=limits,
        gain_V_per_m=file.position_gain,
        pace=file.pace,
    )


def load_rig(reference: str | Path, base: Path | None = None) -> Rig:
    """Return the rig of a file or name; relative paths count from `base`, else from here.

    Raises:
        ConfigError: every problem of the file, its parents and its models.
    """
    sources = Sources()
    path = resolve("rig", str(reference), base or Path.cwd(), sources.problems)
    rig = read_rig(path, sources) if path else None
    sources.problems.raise_if_any()
    assert rig is not None
    return rig


def _with_parents(
    path: Path, sources: Sources, children: tuple[Path, ...], referrer: Located | None = None
) -> Located | None:
    """Return the keys of a rig file, and of its parents where it does not give them itself."""
    if path in children:
        assert referrer is not None
        remedy = "name another parent"
        sources.problems.add(referrer.place, "parent", path.stem, "descends from this rig", remedy)
        return None
    root = sources.read_yaml(path, referrer)
    entry = root.get("parent") if root is not None else None
    reference = reference_in(entry)
    if root is None or entry is None or reference is None:
        return root
    found = resolve("rig", reference, path.parent, sources.problems, entry)
    parent = _with_parents(found, sources, (*children, path), entry) if found else None
    if parent is None:
        return None
    inherited = {key: item for key, item in parent.items() if key not in ("name", "description")}
    return Located({**inherited, **dict(root.items())}, root.place, root.name)


def _read_plant(root: Located, sources: Sources) -> Model | None:
    item = root.get("plant")
    if item is None:
        return None
    if reference_in(item) is not None:
        item = Located({"model": item}, item.place, item.name)
    file = check(PlantFile, item, sources.problems)
    base = None
    if file is not None:
        entry = item.find(("model",))
        found = resolve("model", file.model, entry.place.path.parent, sources.problems, entry)
        base = read_model(found, sources) if found else None
    model = override(base or Model(), item, sources)
    return model if base else None


def _read_sensors(root: Located, sources: Sources) -> SensorParameters | None:
    item = root.get("sensors")
    if item is None:
        return DATA_SHEET
    file = check(_SENSORS_SCHEMA, item, sources.problems)
    if file is None:
        return None
    sensors = SensorParameters(**file.model_dump())
    if sensors.pressure_min >= sensors.pressure_max:
        sources.problems.add(
            item.find(("pressure_max",)).place,
            "pressure_max",
            show(sensors.pressure_max, "Pa"),
            f"is not above pressure_min ({show(sensors.pressure_min, 'Pa')})",
            "correct the transducer's range",
        )
    return sensors


def _read_limits(root: Located, plant: Model | None, sources: Sources) -> Limits | None:
    item = root.get("limits")
    file = check(LimitsFile, item, sources.problems) if item is not None else None
    if item is None or file is None:
        return None
    lower, upper = file.position
    if plant is not None:
        par = plant.parameters
        entry = item.find(("position",))
        if lower < par.stroke_min or upper > par.stroke_max:
            stroke = f"{show(par.stroke_min, 'm')} to {show(par.stroke_max, 'm')}"
            sources.problems.add(
                entry.place,
                "position",
                f"{show(lower, 'm')} to {show(upper, 'm')}",
                f"reaches beyond the stroke of {stroke}",
                "keep the limits within the stroke",
            )
        if file.pressure <= par.supply_pressure:
            sources.problems.add(
                item.find(("pressure",)).place,
                "pressure",
                shown(item.find(("pressure",))),
                f"is not above the supply pressure of {show(par.supply_pressure, 'Pa')}",
                "give the pressure at which the rig must trip",
            )
    return Limits(lower, upper, file.command, file.pressure)
