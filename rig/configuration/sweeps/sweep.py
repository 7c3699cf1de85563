"""Sweep files name a rig, the quantities drawn anew for each case, and the filter that judges."""

from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import Field as SchemaField

from control import ControlSettings
from estimator.leaks import LEARNING_S
from rig.configuration.campaigns import (
    CriterionFile,
    OwnFigureFile,
    TestLimitFile,
    criterion_in_words,
    limit_in_words,
)
from rig.configuration.models import ParameterReader, named_model, physical, read_model
from rig.configuration.reading import (
    Adjustable,
    Field,
    Located,
    Name,
    Physical,
    Schema,
    Under,
    load,
    options_schema,
    quantity_in,
    read_in,
    read_mapping,
    show,
)
from rig.configuration.rigs import Rig, corrected_twice, read_control, read_rig
from rig.plant import (
    LONGEST_STEP,
    NOMINAL,
    REMEMBERING,
    TICK,
    Model,
    Parameters,
    PlantEffect,
    quantities,
)

from .distributions import KINDS, Distribution, Drawn, Random, resolved
from .drawn_fields import DrawnEffects, DrawnParameters
from .expecting import following_lines
from .sweep_motions import MotionContext, motion_files, read_motions
from .sweep_plan import Sweep, SweepFilter
from .swept_adaptive import LEAST_LEAKS
from .swept_asked import asking_of
from .swept_leaks import LeaksFile, read_leaks

_SHORTEST_S: Final = 10.0
_USUAL_S: Final = 60.0
_JUDGED_S: Final = 4.0
_BLOCK_S: Final = 0.5


class SweepFile(Schema):
    """Keys of a sweep file; the mappings under them have their own schemas."""

    name: Name
    description: str = ""
    rig: str
    model: str = "nominal"
    filter: SweepFilter = "thesis-7"
    false_alarms_per_day: Annotated[float, Physical("", 1e-3, 1e3, 1.0)] = 1.0
    duration: Annotated[float, Physical("s", _SHORTEST_S, 3600.0, _USUAL_S)] = _USUAL_S
    longest_step: Annotated[float, Physical("s", LONGEST_STEP, TICK, LONGEST_STEP)] = LONGEST_STEP
    cases: Annotated[int, SchemaField(ge=1, le=10_000_000)]
    seed: Annotated[int, SchemaField(ge=0, lt=2**31)] = 0
    parameters: Annotated[Any, DrawnParameters()] = None
    effects: Annotated[Any, DrawnEffects()] = None
    noise: Annotated[Any, Random(Physical("", 0.0, 100.0, 1.0))] = Drawn("fixed", (1.0,))
    leaks: Annotated[Any, Under(lambda: (LeaksFile,), words=("none",))] = None
    control: Annotated[Any, Under(lambda: (options_schema(ControlSettings),))] = None
    motions: Annotated[Any, Under(motion_files, many=True)]
    figures: Annotated[Any, Under(lambda: (OwnFigureFile,), named=True)] = None
    criteria: Annotated[Any, Under(lambda: (CriterionFile,), many=True)] = None
    limits: Annotated[Any, Under(lambda: (TestLimitFile,), many=True)] = None


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
    filter_name: SweepFilter = "thesis-7" if file is None else file.filter
    rig = _read_rig(root.get("rig"), filter_name)
    model = _read_model(root)
    drawn = _Parameters(rig.plant.parameters if rig is not None else NOMINAL)
    drawn.read(root)
    drawn.check_together()
    duration_s = _USUAL_S if file is None else file.duration
    learning_s = LEARNING_S if filter_name == "thesis-7" else None
    given_s, cases = (None, None) if file is None else (file.duration, file.cases)
    leaks = read_leaks(root.get("leaks"), given_s, learning_s, rig, cases)
    control = read_control(root.get("control"), rig.control if rig is not None else None)
    asking = asking_of(root, rig, filter_name, duration_s)
    context = MotionContext(rig, control, duration_s, 0 if file is None else file.seed, asking)
    motions = read_motions(root.get("motions"), context)
    asking.columns.check()
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
        own_figures=asking.own,
    )


def _check_duration(root: Located, file: SweepFile) -> None:
    """Record a problem if a case's duration is no multiple of 0.5 s or too short for its filter."""
    duration = show(file.duration, "s")
    if abs(file.duration / _BLOCK_S - round(file.duration / _BLOCK_S)) > 1e-6:
        limit = f"is no multiple of {_BLOCK_S:g} s, after which decisions come"
        root.refuse(limit, "round it", duration, "duration")
    if file.filter == "thesis-7" and file.duration < LEARNING_S + _JUDGED_S:
        limit = f"leaves nothing to judge after the {LEARNING_S:g} s that thesis-7 learns in"
        root.refuse(limit, "make it 30 s or more", duration, "duration")


def _read_rig(entry: Located | None, filter_name: SweepFilter) -> Rig | None:
    rig = read_in("rig", entry, read_rig)
    if entry is None or rig is None:
        return None
    for field in REMEMBERING:
        if getattr(rig.plant.parameters, field) != getattr(NOMINAL, field):
            limit = f"has {field}, which remembers more than the plant's states"
            entry.refuse(limit, "name a rig without it, or run it as a campaign", rig.name)
    if rig.calibrations and filter_name == "thesis-7":
        limit = "has calibrations, and thesis-7 takes the readings of lanes as they are"
        entry.refuse(limit, "write `filter: product`, or name a rig without them", rig.name)
    if any(each.channel == "position_m" for each in rig.calibrations):
        limit = "has a calibration of position_m, and the position loop of lanes corrects nothing"
        entry.refuse(limit, "name a rig without it, or run it as a campaign", rig.name)
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


def sweep_lines(sweep: Sweep) -> Iterator[str]:
    """Yield the lines by which `rig check` describes a sweep."""
    yield f"  {sweep.description}"
    most = "at most " if sweep.adaptive else ""
    yield (
        f"  {most}{sweep.cases} cases of {show(sweep.duration_s, 's')} on rigs like "
        f"{sweep.rig.name}, judged by {sweep.filter_name} with the model {sweep.model.name}; "
        f"{most}{sweep.rig_s / 3600.0:.4g} rig-hours"
    )
    drawn = [field for field, law in sweep.parameters.items() if law.is_drawn]
    drawn += ["noise"] if sweep.noise.is_drawn else []
    yield f"  drawn for each case: {', '.join(drawn) or 'no parameter'}"
    of_motions = [name for motion in sweep.motions for name in motion.drawn]
    if of_motions:
        yield f"  drawn of the motions: {', '.join(of_motions)}"
    leaks = sweep.leaks
    if leaks is None:
        yield "  no leaks"
    else:
        levels = f"; {len(leaks.profile)} levels one after the other" if leaks.profile else ""
        yield f"  leaks: {', '.join(leaks.places)}; {100.0 * leaks.healthy:g} % healthy{levels}"
    yield from _adaptive_lines(sweep)
    total = sum(motion.share for motion in sweep.motions)
    shares = (f"{motion.name} {100.0 * motion.share / total:.3g} %" for motion in sweep.motions)
    yield f"  motions: {', '.join(shares)}"
    yield from following_lines(sweep)
    yield from _asked_lines(sweep)
    for calibration in sweep.rig.calibrations:
        yield f"  readings corrected by the {calibration}"
    for doubt in corrected_twice(sweep.rig.calibrations, sweep.model):
        yield f"  warning: {doubt}"


def _adaptive_lines(sweep: Sweep) -> Iterator[str]:
    """Yield the lines that tell how an adaptive sweep draws its leaks; none for another sweep."""
    leaks, adaptive = sweep.leaks, sweep.adaptive
    if leaks is None or adaptive is None:
        return
    low, high = (show(flow, "m^3/s") for flow in leaks.size.support)
    found = f"{100.0 * adaptive.found:g}"
    yield (
        f"  adaptive: the first {adaptive.batch} cases have leaks from {low} to {high}; after each "
        f"{adaptive.batch} cases the draws come nearer to the flow that is named in {found} of 100"
    )
    if adaptive.interval:
        yield (
            f"  a place is done once the upper end of that flow's 95 % interval is at most "
            f"{100.0 * adaptive.interval:g} % above the lower end"
        )
    leaky = adaptive.batch * (1.0 - leaks.healthy) / len(leaks.places)
    if leaky < LEAST_LEAKS:
        yield (
            f"  warning: a batch has {leaky:.3g} leaks of each place; with fewer than "
            f"{LEAST_LEAKS} the draws move by what a few leaks show; raise `batch`"
        )


def _asked_lines(sweep: Sweep) -> Iterator[str]:
    """Yield a line for each segmented motion, figure, criterion and limit of a sweep."""
    for motion in sweep.motions:
        if motion.sequence is not None:
            lasts = show(motion.sequence.duration_s, "s")
            yield f"  {motion.name}: {len(motion.sequence.stretches)} segments, {lasts}"
    for own in sweep.own_figures:
        yield f"  figure {own.name}: {own.expression.text}"
    having: dict[str, list[str]] = {}
    for motion in sweep.motions:
        asked = [f"pass by {criterion_in_words(each)}" for each in motion.criteria]
        asked += [f"limit {limit_in_words(each)}" for each in motion.limits]
        for words in asked:
            having.setdefault(words, []).append(motion.name)
    for words, names in having.items():
        everywhere = len(names) == len(sweep.motions)
        yield f"  {words}" if everywhere else f"  {', '.join(names)}: {words}"
