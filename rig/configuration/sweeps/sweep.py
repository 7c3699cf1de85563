"""Sweep files name a rig, the quantities drawn anew for each case, and the filter that judges."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final, get_args

from pydantic import Field as SchemaField

from control import ControlSettings
from estimator.leaks import LEARNING_S
from faults import LEAK_KINDS
from rig.configuration.campaigns import TYPICAL_PRESSURE
from rig.configuration.models import ParameterReader, named_model, physical, read_model
from rig.configuration.reading import (
    Adjustable,
    Field,
    Located,
    Physical,
    Schema,
    Under,
    load,
    options_schema,
    quantity_in,
    read_in,
    read_mapping,
    show,
    suggestion,
)
from rig.configuration.rigs import Rig, read_control, read_rig
from rig.plant import (
    LONGEST_STEP,
    NOMINAL,
    REMEMBERING,
    TICK,
    LeakName,
    Model,
    Parameters,
    PlantEffect,
    quantities,
)

from .distributions import KINDS, Distribution, Drawn, Random, resolved
from .drawn_fields import DrawnEffects, DrawnParameters
from .expecting import following_lines
from .sweep_motions import motion_files, read_motions
from .sweep_plan import Sweep, SweepFilter, SweptLeaks

INTERNAL_PRESSURE: Final = 2.5e6
"""Pressure difference in Pa that friction makes between the chambers of a moving ram.

The flow of an internal leak is stated at this drop.
"""
_SHORTEST_S: Final = 10.0
_AFTER_ONSET_S: Final = 4.0
_BLOCK_S: Final = 0.5
_LEAKAGE: Final = Physical("m^3/(s Pa^0.5)", 0.0, 1e-6, 4e-9)
_FLOW: Final = Physical("m^3/s", 0.0, 1e-3, 1e-5)


class SweepFile(Schema):
    """Keys of a sweep file; the mappings under them have their own schemas."""

    name: str
    description: str = ""
    rig: str
    model: str = "nominal"
    filter: SweepFilter = "thesis-7"
    false_alarms_per_day: Annotated[float, Physical("", 1e-3, 1e3, 1.0)] = 1.0
    duration: Annotated[float, Physical("s", _SHORTEST_S, 3600.0, 60.0)] = 60.0
    longest_step: Annotated[float, Physical("s", LONGEST_STEP, TICK, LONGEST_STEP)] = LONGEST_STEP
    cases: Annotated[int, SchemaField(ge=1, le=10_000_000)]
    seed: Annotated[int, SchemaField(ge=0, lt=2**31)] = 0
    parameters: Annotated[Any, DrawnParameters()] = None
    effects: Annotated[Any, DrawnEffects()] = None
    noise: Annotated[Any, Random(Physical("", 0.0, 100.0, 1.0))] = Drawn("fixed", (1.0,))
    leaks: Annotated[Any, Under(lambda: (LeaksFile,), words=("none",))] = None
    control: Annotated[Any, Under(lambda: (options_schema(ControlSettings),))] = None
    motions: Annotated[Any, Under(motion_files, many=True)]


class LeaksFile(Schema):
    """Keys of `leaks` in a sweep file: how many cases leak, where, how much and from when on."""

    healthy: Annotated[float, Physical("", 0.0, 1.0, 0.25)] = 0.25
    places: tuple[LeakName, ...] = get_args(LeakName)
    flow: Annotated[Any, Random(_FLOW)] = None
    coefficient: Annotated[Any, Random(_LEAKAGE)] = None
    pressure: Annotated[float | None, Physical("Pa", 1e3, 3.5e7, TYPICAL_PRESSURE)] = None
    onset: Annotated[Any, Random(Physical("s", 0.0, 3600.0, 20.0))]


def load_sweep(reference: str | Path, base: Path | None = None) -> Sweep:
    """Return the sweep that a path or a name means.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file, its rig and its models.
    """
    return load("sweep", reference, base, read_sweep)


def read_sweep(root: Located) -> Sweep | None:
    """Return the sweep that a file describes; record all problems, and return None if any."""
    file = read_mapping(SweepFile, root)
    rig = _read_rig(root.get("rig"))
    model = _read_model(root)
    drawn = _Parameters(rig.plant.parameters if rig is not None else NOMINAL)
    drawn.read(root)
    drawn.check_together()
    leaks = _read_leaks(root.get("leaks"), file, rig)
    control = read_control(root.get("control"), rig.control if rig is not None else None)
    motions = read_motions(root.get("motions"), rig.limits if rig is not None else None, control)
    if file is not None:
        _check_duration(root, file)
    problems, sha256 = root.sources.problems, root.sources.sha256
    if file is None or rig is None or model is None or control is None or problems.found:
        return None
    return Sweep(
        name=file.name,
        description=file.description.strip(),
        path=root.place.path,
        rig=rig,
        model=model,
        filter_name=file.filter,
        false_alarms_per_day=file.false_alarms_per_day,
        duration_s=file.duration,
        longest_step_s=file.longest_step,
        cases=file.cases,
        seed=file.seed,
        parameters=drawn.distributions,
        followers=drawn.followers,
        noise=resolved(file.noise, Physical("", 0.0, 100.0)),
        leaks=leaks,
        motions=motions,
        source_files={str(source): digest for source, digest in sha256.items()},
        control=control,
    )


def _check_duration(root: Located, file: SweepFile) -> None:
    """Record a problem if a case's duration is no multiple of 0.5 s or too short for its filter."""
    duration = show(file.duration, "s")
    if abs(file.duration / _BLOCK_S - round(file.duration / _BLOCK_S)) > 1e-6:
        limit = f"is no multiple of {_BLOCK_S:g} s, after which decisions come"
        root.refuse(limit, "round it", duration, "duration")
    if file.filter == "thesis-7" and file.duration < LEARNING_S + _AFTER_ONSET_S:
        limit = f"leaves nothing to judge after the {LEARNING_S:g} s that thesis-7 learns in"
        root.refuse(limit, "make it 30 s or more", duration, "duration")


def _read_rig(entry: Located | None) -> Rig | None:
    rig = read_in("rig", entry, read_rig)
    if entry is None or rig is None:
        return None
    for field in REMEMBERING:
        if getattr(rig.plant.parameters, field) != getattr(NOMINAL, field):
            limit = f"has {field}, which remembers more than the plant's states"
            entry.refuse(limit, "name a rig without it, or run it as a campaign", rig.name)
    if rig.calibrations:
        limit = "has calibrations, and sweeps do not correct readings"
        entry.refuse(limit, "name a rig without them, or run it as a campaign", rig.name)
    return rig


def _read_model(root: Located) -> Model | None:
    entry, chosen = named_model(root), root.get("filter")
    model = read_in("model", entry, read_model)
    if model is None or chosen is None or chosen.value != "product":
        return model
    for field in ("command_delay", "valve_hysteresis", "supply_droop"):
        if getattr(model.parameters, field) != 0.0:
            limit = f"has {field}, for which each filter in lanes would need a memory of its own"
            entry.refuse(limit, "name another model", model.name)
    return model


class _Parameters(ParameterReader):
    """A reader of `parameters` and `effects`, with a distribution for each field they give.

    After `read`, `distributions` has them by field of `Parameters`, and `followers` maps a field
    to the one with which it is scaled. `base` are the rig's own parameters.
    """

    def __init__(self, base: Parameters) -> None:
        self._base = base
        self.distributions: dict[str, Distribution] = {}
        self.followers: dict[str, str] = {}
        self._entries: dict[str, Located] = {}

    def field_of(self, quantity: Physical) -> Field:
        return Random(Adjustable(quantity))

    def read_effect(self, effect: PlantEffect, entry: Located) -> None:
        alone = not isinstance(entry.value, dict) or bool(set(entry.value) & set(KINDS))
        for knob, drawn, place in self.effect_values(effect, entry, alone):
            self.set(knob.field, drawn, place)
            if knob.followed_by and drawn is not None:
                self.followers[knob.followed_by] = knob.field

    def set(self, field: str, value: Drawn | None, item: Located) -> None:
        if value is None:
            return
        if field in self.distributions:
            item.refuse("is given as a parameter too", "keep one of them", name=field)
            return
        if field in REMEMBERING:
            limit = "remembers more than the plant's states, which a sweep does not"
            item.refuse(limit, "leave it out", name=field)
            return
        base = getattr(self._base, field)
        found = quantity_in(item, lambda: resolved(value, physical(field), base))
        if found is not None:
            self.distributions[field] = found
            self._entries[field] = item

    def _support(self, field: str) -> tuple[float, float]:
        base = float(getattr(self._base, field))
        return self.distributions[field].support if field in self.distributions else (base, base)

    def check_together(self) -> None:
        """Record a problem for each pair of parameters that may contradict each other in a case.

        Before that, remove from `followers` the fields to which the file gives a distribution.
        """
        self.followers = {
            follower: field
            for follower, field in self.followers.items()
            if follower not in self.distributions
        }
        for larger, smaller in (
            ("stroke_max", "stroke_min"), ("supply_pressure", "return_pressure"),
            ("stiction", "coulomb"),
        ):  # fmt: skip
            given = [field for field in (larger, smaller) if field in self._entries]
            least, most = self._support(larger)[0], self._support(smaller)[1]
            if not given or self.followers.get(larger) == smaller or least >= most:
                continue
            unit = quantities()[larger].unit
            limit = (
                f"lets {larger} come to {show(least, unit)}, below a {smaller} of "
                f"{show(most, unit)}"
            )
            self._entries[given[0]].refuse(limit, "keep them apart")


def _read_leaks(
    item: Located | None, sweep: SweepFile | None, rig: Rig | None
) -> SweptLeaks | None:
    if item is None or item.value == "none":
        return None
    file = read_mapping(LeaksFile, item)
    if file is None:
        return None
    sizes = {name: drawn for name in ("flow", "coefficient") if (drawn := getattr(file, name))}
    if len(sizes) != 1:
        limit = "has both flow and coefficient" if sizes else "has no size"
        item.refuse(limit, "give flow or coefficient", "")
        return None
    name, drawn = next(iter(sizes.items()))
    _check_places(item, file, rig)
    entry, limits = item.find(name), _FLOW if name == "flow" else _LEAKAGE
    size = quantity_in(entry, lambda: resolved(drawn, limits))
    if size is not None and size.support[0] <= 0.0:
        entry.refuse("may be no leak at all", "give its part of all cases as `healthy`")
    entry, seconds = item.find("onset"), Physical("s", 0.0, 3600.0)
    onset = quantity_in(entry, lambda: resolved(file.onset, seconds))
    if onset is not None and sweep is not None:
        _check_onset(entry, onset, sweep)
    if size is None or onset is None:
        return None
    usual = {**dict.fromkeys(file.places, TYPICAL_PRESSURE), "internal_leakage": INTERNAL_PRESSURE}
    pressures = tuple(file.pressure or usual[place] for place in file.places)
    return SweptLeaks(
        file.healthy, tuple(file.places), size, pressures if name == "flow" else None, onset
    )


def _check_places(item: Located, file: LeaksFile, rig: Rig | None) -> None:
    if not file.places:
        remedy = f"name some of {', '.join(LEAK_KINDS)}"
        item.refuse("is empty", remedy, "[]", "places")
    if len(set(file.places)) < len(file.places):
        item.refuse("names one twice", "name each once", key="places")
    for place in file.places:
        if rig is not None and place not in rig.injectable:
            remedy = suggestion(place, rig.injectable, "bypasses")
            item.refuse(f"is no bypass of {rig.name}", remedy, place, "places")


def _check_onset(entry: Located, onset: Distribution, sweep: SweepFile) -> None:
    first, last = onset.support
    if last > sweep.duration - _AFTER_ONSET_S:
        limit = f"may come later than {_AFTER_ONSET_S:g} s before the end, {sweep.duration:g} s"
        entry.refuse(limit, "let it begin earlier")
    if sweep.filter == "thesis-7" and first < LEARNING_S:
        limit = f"may fall into the {LEARNING_S:g} s in which thesis-7 learns what is healthy"
        entry.refuse(limit, "let it begin later")


def sweep_lines(sweep: Sweep) -> Iterator[str]:
    """Yield the lines by which `rig check` describes a sweep."""
    yield f"  {sweep.description}"
    yield (
        f"  {sweep.cases} cases of {show(sweep.duration_s, 's')} on rigs like {sweep.rig.name}, "
        f"judged by {sweep.filter_name} with the model {sweep.model.name}; "
        f"{sweep.rig_s / 3600.0:.4g} rig-hours"
    )
    drawn = [field for field, law in sweep.parameters.items() if law.is_drawn]
    yield f"  drawn for each case: {', '.join(drawn) or 'no parameter'}"
    leaks = sweep.leaks
    if leaks is None:
        yield "  no leaks"
    else:
        yield f"  leaks: {', '.join(leaks.places)}; {100.0 * leaks.healthy:g} % healthy"
    total = sum(motion.share for motion in sweep.motions)
    shares = (f"{motion.name} {100.0 * motion.share / total:.3g} %" for motion in sweep.motions)
    yield f"  motions: {', '.join(shares)}"
    yield from following_lines(sweep)
