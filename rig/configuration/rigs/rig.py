"""Rig files describe a rig: its parts, what it can measure and inject, and its limits."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from control import POSITION_GAIN
from faults import BypassValve
from rig.configuration.models import override, read_model
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    load,
    read_mapping,
    read_options,
    reference_in,
    resolve_in,
    show,
)
from rig.io import ChannelLimit, DriverSpec, HomingSettings, LoopSettings
from rig.plant import Model, SensorParameters

from .drivers import read_drivers
from .hardware import check_hardware, check_rates, check_rungs, moved_faults
from .limits import Limits, read_ladder, read_limits, usual_ladder
from .valves import ReturnValve, read_bypass_valves, read_return_valve

Backend = Literal["simulated", "hardware"]
Pace = Literal["real", "fast"]


@dataclass(frozen=True)
class Rig:
    """A rig as its file describes it.

    Attributes:
        name: name of the rig.
        description: text for people.
        backend: whether the rig is simulated or hardware.
        plant: the true physics of a simulated rig, which the detector does not know; for a hardware
            rig, the model by which `rig check` computes and which the emulator simulates.
        sensors: noise, range and resolution of the transducers.
        has_supply_pressure_sensor: whether the supply pressure is measured.
        has_load_cell: whether the load is measured.
        has_spool_sensor: whether the spool's position is measured.
        bypass_valves: kind of fault -> the valve that makes it.
        return_valve: the valve that can block the return line; None if there is none.
        limits: what a test may ask of the rig.
        gain_V_per_m: gain of the proportional position loop.
        pace: whether campaigns run at the wall clock ("real") or as fast as they can ("fast"),
            unless a command line chooses. A hardware rig always runs at the wall clock.
        ladder: limits of channels, each with the action that is taken beyond it.
        drivers: drivers of a hardware rig, exactly one of them fast; () for a simulated rig.
        loop: how the loop of a hardware rig is paced and watched.
        homing: how the encoder finds its zero; None if the encoder always knows the position.
    """

    name: str
    description: str
    backend: Backend
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
    ladder: tuple[ChannelLimit, ...] = ()
    drivers: tuple[DriverSpec, ...] = ()
    loop: LoopSettings = field(default_factory=LoopSettings)
    homing: HomingSettings | None = None

    @property
    def injectable(self) -> tuple[str, ...]:
        """The kinds of fault whose valves the rig has and can move."""
        fitted = (*self.bypass_valves, *(["return_blockage"] if self.return_valve else []))
        if self.backend == "simulated":
            return fitted
        moved = moved_faults(self.drivers)
        return tuple(kind for kind in fitted if kind in moved)


class RigFile(Schema):
    """Keys of a rig file; the mappings under them have their own schemas."""

    name: str
    description: str = ""
    parent: str | None = None
    backend: Backend = "simulated"
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
    drivers: Any = None
    loop: Any = None
    homing: Any = None


class PlantFile(Schema):
    """Keys of a rig's plant: a model, and the changes by which the rig differs from it."""

    model: str
    parameters: Any = None
    friction_law: Literal["bristle", "karnopp"] | None = None
    effects: Any = None


def read_rig(path: Path, sources: Sources) -> Rig | None:
    """Return the rig in a file, with its parents' keys; None if it cannot be made.

    Problems are added to those of `sources`. A rig may be returned in spite of problems, for
    example without the valves or drivers that are wrong; it may only be used if there are none.
    """
    root = _with_parents(path, sources, ())
    if root is None:
        return None
    problems = sources.problems
    file = read_mapping(RigFile, root, problems)
    plant = _read_plant(root, sources)
    sensors = _read_sensors(root, sources)
    bypass_valves = read_bypass_valves(root.get("bypass_valves"), sources)
    return_valve = read_return_valve(root.get("return_valve"), problems)
    limits = read_limits(root.get("limits"), plant, problems)
    rungs = read_ladder(root.get("limits"), problems)
    loop = read_options(LoopSettings, root.get("loop"), sources)
    homing = root.get("homing")
    settings = read_options(HomingSettings, homing, sources) if homing is not None else None
    drivers = _read_drivers(root, file, loop, rungs, sources)
    if file is None or plant is None or sensors is None or limits is None or loop is None:
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
        pace="real" if file.backend == "hardware" else file.pace,
        ladder=(*usual_ladder(limits, plant.parameters), *rungs),
        drivers=drivers,
        loop=loop,
        homing=settings,
    )


def load_rig(reference: str | Path, base: Path | None = None) -> Rig:
    """Return the rig that a path or a name means.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file, its parents and its models.
    """
    return load("rig", reference, base, read_rig)


def _with_parents(
    path: Path, sources: Sources, children: tuple[Path, ...], referrer: Located | None = None
) -> Located | None:
    """Return the keys of a rig file, with its parents' values for keys that it does not give.

    Name and description are not inherited. If a file is unusable, or a rig is its own ancestor, add
    a problem and return None. `children` are the files that led here.
    """
    if path in children:
        assert referrer is not None
        remedy = "name another parent"
        sources.problems.add(referrer.place, "parent", path.stem, "descends from this rig", remedy)
        return None
    root = sources.read_yaml(path, referrer)
    entry = root.get("parent") if root is not None else None
    if root is None or reference_in(entry) is None:
        return root
    found = resolve_in("rig", entry, sources.problems)
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
    file = read_mapping(PlantFile, item, sources.problems)
    base = None
    if file is not None:
        found = resolve_in("model", item.find(("model",)), sources.problems)
        base = read_model(found, sources) if found else None
    model = override(base or Model(), item, sources)
    return model if base else None


def _read_drivers(
    root: Located,
    file: RigFile | None,
    loop: LoopSettings | None,
    rungs: tuple[ChannelLimit, ...],
    sources: Sources,
) -> tuple[DriverSpec, ...]:
    """Return the drivers of a hardware rig; () for a simulated rig, even if it inherits some.

    Problems are recorded, also where a simulated rig's own file has drivers.
    """
    item = root.get("drivers")
    hardware = file is not None and file.backend == "hardware"
    if not hardware and item is not None and item.place.path == root.place.path:
        remedy = "add `backend: hardware`, or remove them"
        sources.problems.add(item.place, "drivers", "", "drive a simulated rig", remedy)
    if not hardware:
        return ()
    if item is None:
        remedy = "add `drivers: {...}`, one of them fast"
        sources.problems.add(root.place, "drivers", "", "are missing", remedy)
        return ()
    placed = read_drivers(item, sources)
    if placed is None:
        return ()
    specs = tuple(driver.spec for driver in placed)
    check_hardware(root, placed, sources.problems)
    check_rungs(root.get("limits"), rungs, specs, sources.problems)
    if loop is not None:
        check_rates(root, loop, specs, sources.problems)
    return specs


def _read_sensors(root: Located, sources: Sources) -> SensorParameters | None:
    item = root.get("sensors")
    sensors = read_options(SensorParameters, item, sources)
    if item is not None and sensors is not None and sensors.pressure_min >= sensors.pressure_max:
        sources.problems.add(
            item.find(("pressure_max",)).place,
            "pressure_max",
            show(sensors.pressure_max, "Pa"),
            f"is not above pressure_min ({show(sensors.pressure_min, 'Pa')})",
            "correct the transducer's range",
        )
    return sensors
