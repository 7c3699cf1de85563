"""Rig files describe a rig: its parts, what it can measure and inject, and its limits."""

import datetime
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal, get_args

from control import POSITION_GAIN, ControlSettings
from faults import BypassValve
from rig.configuration.models import override, read_model
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    Under,
    asked,
    load,
    options_schema,
    read_in,
    read_mapping,
    read_options,
    reference_in,
    resolve,
    show,
)
from rig.io import (
    ChannelLimit,
    DriverSpec,
    HomingSettings,
    LoopSettings,
    TransducerCalibration,
    Wiring,
    today,
)
from rig.plant import Model, SensorParameters

from .blocking import BlockingFile, BlockingValves, read_blocking_valves
from .calibrated import Expired, TransducerFiles, measured_by, read_calibrations, uncalibrated
from .control import UNLESS_USUAL, read_control
from .drivers import driver_files, read_drivers
from .hardware import check_hardware, check_rates, check_rungs, moved_faults
from .limits import Limits, LimitsFile, read_ladder, read_limits, usual_ladder
from .valves import (
    BYPASS_KINDS,
    BypassFile,
    ReturnValve,
    ReturnValveFile,
    read_bypass_valves,
    read_return_valve,
)
from .wiring import read_wiring

GAIN: Final = Physical("V/m", 0.1, 1e4, POSITION_GAIN)
"""Unit and limits of the gain of a position loop."""

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
        control: what the position loop adds to gain times error, unless a test has its own.
        calibrations: calibrations of the transducers, by which readings are corrected.
        uncalibrated: measured channels without calibration; () if no channel has one.
        wiring: how a hardware rig is wired, against the names in its device's register map.
        blocking_valves: the valves that lock the cylinder; None if there are none.
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
    control: ControlSettings = field(default_factory=ControlSettings, metadata=UNLESS_USUAL)
    calibrations: tuple[TransducerCalibration, ...] = field(default=(), metadata=UNLESS_USUAL)
    uncalibrated: tuple[str, ...] = field(default=(), metadata=UNLESS_USUAL)
    wiring: Wiring = field(default_factory=Wiring, metadata=UNLESS_USUAL)
    blocking_valves: BlockingValves | None = field(default=None, metadata=UNLESS_USUAL)

    @property
    def injectable(self) -> tuple[str, ...]:
        """The kinds of fault whose valves the rig has and, on hardware, its drivers can move."""
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
    plant: Annotated[Any, Under(lambda: (PlantFile,), text=True)]
    sensors: Annotated[Any, Under(lambda: (options_schema(SensorParameters),))] = None
    supply_pressure_sensor: bool = False
    load_cell: bool = False
    spool_sensor: bool = False
    bypass_valves: Annotated[Any, Under(lambda: (BypassFile,), named=True, names=BYPASS_KINDS)] = (
        None
    )
    return_valve: Annotated[Any, Under(lambda: (ReturnValveFile,))] = None
    blocking_valves: Annotated[Any, Under(lambda: (BlockingFile,))] = None
    limits: Annotated[Any, Under(lambda: (LimitsFile,))]
    position_gain: Annotated[float, GAIN] = POSITION_GAIN
    pace: Pace = "fast"
    drivers: Annotated[Any, Under(driver_files, named=True)] = None
    loop: Annotated[Any, Under(lambda: (options_schema(LoopSettings),))] = None
    homing: Annotated[Any, Under(lambda: (options_schema(HomingSettings),))] = None
    wiring: Annotated[Any, Under(lambda: (options_schema(Wiring),))] = None
    control: Annotated[Any, Under(lambda: (options_schema(ControlSettings),))] = None
    calibrations: Annotated[Any, TransducerFiles()] = None
    expired_calibrations: Expired = "warn"


class PlantFile(Schema):
    """Keys of a rig's plant: a model, and the changes by which the rig differs from it."""

    model: str
    parameters: Any = None
    friction_law: Literal["bristle", "karnopp"] | None = None
    effects: Any = None


LONGEST_NAME: Final = 200
"""Most characters of a rig's name: the file of its counters is named by it, and a file's name, with
what is added to it while it is written, may have 255 bytes."""


def read_rig(own: Located, day: datetime.date | None = None) -> Rig | None:
    """Return the rig that a file describes, with its parents' keys; None if it cannot be made.

    Problems are recorded. A rig may be returned in spite of problems, for example without the
    valves or drivers that are wrong; it may only be used if there are none. `day` is the day on
    which calibrations are to hold, today if None.
    """
    root = _with_parents(own, ())
    if root is None:
        return None
    file = read_mapping(RigFile, root)
    if file is not None and len(file.name) > LONGEST_NAME:
        limit = f"has {len(file.name)} characters, above {LONGEST_NAME}"
        root.refuse(limit, "shorten it", key="name")
    plant = _read_plant(root.get("plant"))
    sensors = _read_sensors(root.get("sensors"))
    bypass_valves = read_bypass_valves(root.get("bypass_valves"))
    return_valve = read_return_valve(root.get("return_valve"))
    backend = _backend_of(root, file)
    limits = read_limits(root.get("limits"), plant)
    rungs = read_ladder(root.get("limits"))
    loop = read_options(LoopSettings, root.get("loop"))
    homing = root.get("homing")
    settings = read_options(HomingSettings, homing) if homing is not None else None
    drivers = _read_drivers(root, backend, loop, rungs)
    blocking = read_blocking_valves(root.get("blocking_valves"), backend, drivers)
    control = read_control(root.get("control"))
    wiring = read_wiring(root, backend != "simulated")
    measured = _measured(file, drivers) if file is not None else None
    calibrations = read_calibrations(root, measured, homing is not None, day or today())
    if file is None or plant is None or sensors is None or limits is None or loop is None:
        return None
    if control is None or wiring is None:
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
        control=control,
        calibrations=calibrations,
        uncalibrated=uncalibrated(calibrations, measured or frozenset()),
        wiring=wiring,
        blocking_valves=blocking,
    )


def load_rig(
    reference: str | Path, base: Path | None = None, day: datetime.date | None = None
) -> Rig:
    """Return the rig that a path or a name means.

    `base` is the folder from which relative paths are resolved; the working directory if None.
    `day` is the day on which calibrations are to hold; today if None.

    Raises:
        ConfigError: lists every problem of the file, its parents, models and transducer files.
    """
    return load("rig", reference, base, lambda own: read_rig(own, day))


def find_rig(reference: str | Path, base: Path | None = None) -> Path:
    """Return the file that a path or a name of a rig means; see `load_rig`.

    Raises:
        ConfigError: there is no such file.
    """
    sources = Sources()
    return sources.finished(resolve("rig", asked("rig", reference, sources), base or Path.cwd()))


def _with_parents(root: Located, children: tuple[Path, ...]) -> Located | None:
    """Return the mapping of a rig file, with its parents' values for keys that it does not give.

    Name and description are not inherited. If a parent is unusable, or a rig is its own ancestor,
    add a problem and return None. `children` are the files that name this one as parent, directly
    or not.
    """
    entry = root.get("parent")
    if entry is None or reference_in(entry) is None:
        return root
    path, children = resolve("rig", entry), (*children, root.place.path)
    if path is not None and path in children:
        entry.refuse("descends from this rig", "name another parent", path.stem)
        return None
    given = entry.sources.read_yaml(path, entry)
    parent = _with_parents(given, children) if given is not None else None
    if parent is None:
        return None
    inherited = {key: item for key, item in parent.items() if key not in ("name", "description")}
    return root.completed_by(parent.with_value(inherited))


def _measured(file: RigFile, drivers: tuple[DriverSpec, ...]) -> frozenset[str] | None:
    return measured_by(
        file.backend == "simulated",
        drivers,
        supply_pressure_sensor=file.supply_pressure_sensor,
        load_cell=file.load_cell,
        spool_sensor=file.spool_sensor,
    )


def _read_plant(item: Located | None) -> Model | None:
    if item is None:
        return None
    if reference_in(item) is not None:
        item = item.with_value({"model": item})
    file = read_mapping(PlantFile, item)
    base = read_in("model", item.find("model"), read_model) if file is not None else None
    model = override(base or Model(), item)
    return model if base else None


def _backend_of(root: Located, file: RigFile | None) -> Backend | None:
    """Return the backend of a rig; None if another mistake in its file leaves that open.

    What is wrong only on one backend must not be told where it is not known to be that one.
    """
    item = root.get("backend")
    if item is not None and item.place.path == root.place.path:
        return next((each for each in get_args(Backend) if each == item.value), None)
    # A key that is not known may be this one, misspelt.
    if file is None or any(key not in RigFile.model_fields for key, _ in root.items()):
        return None
    return file.backend


def _read_drivers(
    root: Located,
    backend: Backend | None,
    loop: LoopSettings | None,
    rungs: tuple[ChannelLimit, ...],
) -> tuple[DriverSpec, ...]:
    """Return the drivers of a hardware rig, after checks against the rest of its file.

    The result is () for a simulated rig, even if it inherits drivers, and if a driver is unusable.
    Problems are recorded, also if a simulated rig's own file has drivers.
    """
    item = root.get("drivers")
    if backend != "hardware":
        if backend is not None and item is not None and item.place.path == root.place.path:
            item.refuse("drive a simulated rig", "add `backend: hardware`, or remove them", "")
        return ()
    if item is None:
        root.refuse("are missing", "add `drivers: {...}`, one of them fast", "", "drivers")
        return ()
    drivers = read_drivers(item)
    if drivers is None:
        return ()
    check_hardware(root, drivers)
    check_rungs(root.get("limits"), rungs, drivers)
    if loop is not None:
        check_rates(root, loop, drivers)
    return tuple(driver.spec for driver in drivers)


def _read_sensors(item: Located | None) -> SensorParameters | None:
    sensors = read_options(SensorParameters, item)
    if item is not None and sensors is not None and sensors.pressure_min >= sensors.pressure_max:
        limit = f"is not above pressure_min ({show(sensors.pressure_min, 'Pa')})"
        remedy = "correct the transducer's range"
        item.refuse(limit, remedy, show(sensors.pressure_max, "Pa"), "pressure_max")
    return sensors
