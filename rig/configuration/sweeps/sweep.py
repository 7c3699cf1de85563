"""Sweep files name a rig, the quantities drawn anew for each case, and the filter that judges."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, get_args

from pydantic import Field as SchemaField

from estimator.leaks import LEARNING_S
from faults import LEAK_KINDS
from rig.configuration.campaigns import TYPICAL_PRESSURE, plain
from rig.configuration.models import (
    BELONGS_TO_EFFECT,
    PARAMETERS,
    effect_values,
    parameter_schemas,
    physical,
    read_model,
)
from rig.configuration.reading import (
    Adjustable,
    Located,
    Physical,
    Problems,
    Schema,
    Sources,
    load,
    quantity_in,
    read_mapping,
    resolve_in,
    show,
    shown,
    suggestion,
)
from rig.configuration.rigs import Rig, read_rig
from rig.plant import (
    CATALOGUE,
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
from .sweep_motions import read_motions
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
    parameters: Any = None
    effects: Any = None
    noise: Annotated[Any, Random(Physical("", 0.0, 100.0, 1.0))] = Drawn("fixed", (1.0,))
    leaks: Any = None
    motions: Any


class LeaksFile(Schema):
    """Keys of a sweep's leaks."""

    healthy: Annotated[float, Physical("", 0.0, 1.0, 0.25)] = 0.25
    places: tuple[LeakName, ...] = get_args(LeakName)
    flow: Annotated[Any, Random(_FLOW)] = None
    coefficient: Annotated[Any, Random(_LEAKAGE)] = None
    pressure: Annotated[float | None, Physical("Pa", 1e3, 3.5e7, TYPICAL_PRESSURE)] = None
    onset: Annotated[Any, Random(Physical("s", 0.0, 3600.0, 20.0))]


_SCHEMAS: Final = parameter_schemas(lambda quantity: Random(Adjustable(quantity)))


def load_sweep(reference: str | Path, base: Path | None = None) -> Sweep:
    """Return the sweep that a path or a name means.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file, its rig and its models.
    """
    return load("sweep", reference, base, read_sweep)


def read_sweep(path: Path, sources: Sources) -> Sweep | None:
    """Return the sweep in a file; if there is any problem, record it in `sources`, return None."""
    root = sources.read_yaml(path)
    if root is None:
        return None
    problems = sources.problems
    file = read_mapping(SweepFile, root, problems)
    rig = _read_rig(root, sources)
    model = _read_model(root, sources)
    plant = rig.plant.parameters if rig is not None else None
    duration_s = file.duration if file is not None else None
    drawn = _Parameters(plant or NOMINAL, problems).read(root)
    filter_name: SweepFilter = file.filter if file is not None else "product"
    leaks = _read_leaks(root.get("leaks"), duration_s, filter_name, rig, problems)
    item = root.get("motions")
    limits = rig.limits if rig is not None else None
    motions = read_motions(item, limits, plant, problems) if item is not None else ()
    if file is not None:
        _check_duration(file, root, problems)
    if file is None or rig is None or model is None or problems.found:
        return None
    sweep = Sweep(
        name=file.name,
        description=file.description.strip(),
        path=path,
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
        noise=resolved(file.noise, limits=Physical("", 0.0, 100.0)),
        leaks=leaks,
        motions=motions,
        source_files={str(source): digest for source, digest in sources.sha256.items()},
        meaning={},
    )
    return replace(sweep, meaning=_meaning(sweep))


def _check_duration(file: SweepFile, root: Located, problems: Problems) -> None:
    """Record a problem if a case's duration is no multiple of 0.5 s or too short for its filter."""
    entry = root.find(("duration",))
    duration = show(file.duration, "s")
    if abs(file.duration / _BLOCK_S - round(file.duration / _BLOCK_S)) > 1e-6:
        limit = f"is no multiple of {_BLOCK_S:g} s, after which decisions come"
        problems.add(entry.place, "duration", duration, limit, "round it")
    if file.filter == "thesis-7" and file.duration < LEARNING_S + _AFTER_ONSET_S:
        limit = f"leaves nothing to judge after the {LEARNING_S:g} s that thesis-7 learns in"
        problems.add(entry.place, "duration", duration, limit, "make it 30 s or more")


def _meaning(sweep: Sweep) -> dict[str, Any]:
    """Return everything that the results of a sweep depend on, as plain values in SI."""
    rig = sweep.rig
    return {
        "name": sweep.name,
        "plant": plain(rig.plant.parameters),
        "sensors": plain(rig.sensors),
        "measured": [rig.has_spool_sensor, rig.has_supply_pressure_sensor],
        "position_gain": rig.gain_V_per_m,
        "command_limit": rig.limits.command_V,
        "model": plain(sweep.model.parameters),
        "filter": sweep.filter_name,
        "false_alarms_per_day": sweep.false_alarms_per_day,
        "duration_s": sweep.duration_s,
        "longest_step_s": sweep.longest_step_s,
        "cases": sweep.cases,
        "seed": sweep.seed,
        "parameters": plain(sweep.parameters),
        "followers": plain(sweep.followers),
        "noise": plain(sweep.noise),
        "leaks": plain(sweep.leaks),
        "motions": plain(sweep.motions),
    }


def _read_rig(root: Located, sources: Sources) -> Rig | None:
    entry = root.get("rig")
    found = resolve_in("rig", entry, sources.problems)
    rig = read_rig(found, sources) if found is not None else None
    if entry is None or rig is None:
        return None
    for field in REMEMBERING:
        value = getattr(rig.plant.parameters, field)
        if value != getattr(NOMINAL, field):
            limit = f"has {field}, which remembers more than the plant's states"
            remedy = "name a rig without it, or run it as a campaign"
            sources.problems.add(entry.place, "rig", rig.name, limit, remedy)
    return rig


def _read_model(root: Located, sources: Sources) -> Model | None:
    entry = root.get("model") or Located("nominal", root.place, "model")
    found = resolve_in("model", entry, sources.problems)
    model = read_model(found, sources) if found is not None else None
    chosen = root.get("filter")
    if model is None or chosen is None or chosen.value != "product":
        return model
    for field in ("command_delay", "valve_hysteresis", "supply_droop"):
        if getattr(model.parameters, field) != 0.0:
            limit = f"has {field}, for which each filter in lanes would need a memory of its own"
            sources.problems.add(entry.place, "model", model.name, limit, "name another model")
    return model


class _Parameters:
    """A reader of `parameters` and `effects`, with a distribution for each field they give."""

    def __init__(self, base: Parameters, problems: Problems) -> None:
        self._base, self._problems = base, problems
        self.distributions: dict[str, Distribution] = {}
        self.followers: dict[str, str] = {}
        self._entries: dict[str, Located] = {}

    def read(self, root: Located) -> "_Parameters":
        parameters, effects = root.get("parameters"), root.get("effects")
        if parameters is not None:
            file = read_mapping(_SCHEMAS.parameters, parameters, self._problems, BELONGS_TO_EFFECT)
            for field in PARAMETERS:
                self._set(field, getattr(file, field, None), parameters.find((field,)))
        if effects is not None:
            read_mapping(_SCHEMAS.effects, effects, self._problems)
            for name, entry in effects.items():
                if name in CATALOGUE:
                    self._read_effect(CATALOGUE[name], entry)
        self._check_together(root)
        return self

    def _read_effect(self, effect: PlantEffect, entry: Located) -> None:
        alone = not isinstance(entry.value, dict) or bool(set(entry.value) & set(KINDS))
        for knob, drawn, place in effect_values(effect, entry, alone, _SCHEMAS, self._problems):
            self._set(knob.field, drawn, place)
            if knob.followed_by and drawn is not None:
                self.followers[knob.followed_by] = knob.field

    def _set(self, field: str, drawn: Drawn | None, item: Located) -> None:
        if drawn is None:
            return
        if field in self.distributions:
            limit = "is given as a parameter too"
            self._problems.add(item.place, field, shown(item), limit, "keep one of them")
            return
        if field in REMEMBERING:
            limit = "remembers more than the plant's states, which a sweep does not"
            self._problems.add(item.place, field, shown(item), limit, "leave it out")
            return
        base = getattr(self._base, field)
        found = quantity_in(item, lambda: resolved(drawn, base, physical(field)), self._problems)
        if found is not None:
            self.distributions[field] = found
            self._entries[field] = item

    def _support(self, field: str) -> tuple[float, float]:
        base = float(getattr(self._base, field))
        return self.distributions[field].support if field in self.distributions else (base, base)

    def _check_together(self, root: Located) -> None:
        """Record a problem for each pair of parameters that may contradict each other in a case.

        Fields that the file gives itself are removed from the followers before.
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
            entry, unit = self._entries[given[0]], quantities()[larger].unit
            limit = (
                f"lets {larger} come to {show(least, unit)}, below a {smaller} of "
                f"{show(most, unit)}"
            )
            self._problems.add(entry.place, entry.name, shown(entry), limit, "keep them apart")


def _read_leaks(
    item: Located | None,
    duration_s: float | None,
    filter_name: SweepFilter,
    rig: Rig | None,
    problems: Problems,
) -> SweptLeaks | None:
    if item is None or item.value == "none":
        return None
    file = read_mapping(LeaksFile, item, problems)
    if file is None:
        return None
    sizes = {name: drawn for name in ("flow", "coefficient") if (drawn := getattr(file, name))}
    if len(sizes) != 1:
        limit = "has both flow and coefficient" if sizes else "has no size"
        problems.add(item.place, "leaks", "", limit, "give flow or coefficient")
        return None
    name, drawn = next(iter(sizes.items()))
    _check_places(item, file, rig, problems)
    entry, limits = item.find((name,)), _FLOW if name == "flow" else _LEAKAGE
    size = quantity_in(entry, lambda: resolved(drawn, limits=limits), problems)
    if size is not None and size.support[0] <= 0.0:
        remedy = "give its part of all cases as `healthy`"
        problems.add(entry.place, name, shown(entry), "may be no leak at all", remedy)
    entry, seconds = item.find(("onset",)), Physical("s", 0.0, 3600.0)
    onset = quantity_in(entry, lambda: resolved(file.onset, limits=seconds), problems)
    if onset is not None and duration_s is not None:
        _check_onset(entry, onset, duration_s, filter_name, problems)
    if size is None or onset is None:
        return None
    pressures = tuple(_drop(place, file.pressure) for place in file.places)
    return SweptLeaks(
        file.healthy, tuple(file.places), size, pressures if name == "flow" else None, onset
    )


def _drop(place: str, given: float | None) -> float:
    if given is not None:
        return given
    return INTERNAL_PRESSURE if place == "internal_leakage" else TYPICAL_PRESSURE


def _check_places(item: Located, file: LeaksFile, rig: Rig | None, problems: Problems) -> None:
    entry = item.find(("places",))
    if not file.places:
        problems.add(
            entry.place, "places", "[]", "is empty", f"name some of {', '.join(LEAK_KINDS)}"
        )
    if len(set(file.places)) < len(file.places):
        problems.add(entry.place, "places", shown(entry), "names one twice", "name each once")
    for place in file.places:
        if rig is not None and place not in rig.injectable:
            remedy = suggestion(place, rig.injectable, "bypasses")
            problems.add(entry.place, "places", place, f"is no bypass of {rig.name}", remedy)


def _check_onset(
    entry: Located,
    onset: Distribution,
    duration_s: float,
    filter_name: SweepFilter,
    problems: Problems,
) -> None:
    first, last = onset.support
    if last > duration_s - _AFTER_ONSET_S:
        limit = f"may come later than {_AFTER_ONSET_S:g} s before the end, {duration_s:g} s"
        problems.add(entry.place, "onset", shown(entry), limit, "let it begin earlier")
    if filter_name == "thesis-7" and first < LEARNING_S:
        limit = f"may fall into the {LEARNING_S:g} s in which thesis-7 learns what is healthy"
        problems.add(entry.place, "onset", shown(entry), limit, "let it begin later")


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
