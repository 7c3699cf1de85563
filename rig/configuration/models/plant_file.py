"""Model files of plants that a user describes in Python are read and written here.

Such a file has the plant's values, its channels, and by how much the model may be wrong. The plant
itself, with its equations and effects, is a Python module (`plant_loading`).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Annotated, Any, Final

import yaml

from estimator.gap import (
    Addition,
    Parameter,
    Plant,
    PlantDescription,
    build,
    check_course,
    check_description,
    nuisances,
)
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    quantity_in,
    read_mapping,
    shown,
    suggestion,
)
from rig.recording import Column, Recording, RecordingError, read_measured, read_sampling

from .additions import read_additions, vocabulary, written_additions
from .columns import TIME, checked, column_in
from .discovered import KEY
from .model_writing import plain_provenance

ALIKE: Final = 0.1
"""Greatest difference of a recording's period from that of the others, as a part of it."""
REVISED: Final = "revised"
_COMMENT_COLUMN: Final = 48
_CARRIED: Final = ("period", "channels", "tolerances", "model_error", "steering")


@dataclass(frozen=True)
class PlantModel:
    """A plant with the values of its model file, and the columns of its recordings.

    Attributes:
        name: name of the model.
        plant: the plant, as the gap workflow uses it.
        columns: channel -> column of a recording, for channels that have another name or unit
            there.
        effects: names of the effects that the model file switches on.
        content: the model file as plain values.
        row_s: period of the rows of its recordings, s; None if any will do.
    """

    name: str
    plant: Plant
    columns: Mapping[str, Column]
    effects: tuple[str, ...]
    content: Mapping[str, Any] = field(repr=False)
    row_s: float | None = None

    def read(self, path: str | Path) -> Recording:
        """Return the recording in a file, with the plant's channel names, in SI, at its period.

        Raises:
            RecordingError: lists every problem of the file.
            PlantError: the plant's states do not stay finite along this recording.
        """
        period = self.plant.period
        recording = read_measured(
            path,
            held=self.plant.inputs,
            measured=[output.channel for output in self.plant.outputs],
            period=period,
            columns=self.columns,
            of_rig=False,
        )
        assert recording.sampling is not None
        own = recording.sampling.period
        if self.row_s is not None and abs(own / self.row_s - 1.0) > ALIKE:
            raise RecordingError.of_file(
                str(path), f"has a row every {own * 1e3:.4g} ms",
                "give recordings of one period, or add `period` to the model file",
                f"the first recording, or the plant, has one every {self.row_s * 1e3:.4g} ms",
            )  # fmt: skip
        check_course(recording, self.plant)
        return recording


class _File(Schema):
    name: str
    description: str = ""
    period: Annotated[Any, Physical("s", 1e-4, 1.0)] = None
    parameters: Any
    effects: Any = None
    channels: Any = None
    tolerances: Any = None
    model_error: Any = None
    steering: Any = None
    discovered: Any = None
    provenance: Any = None


def catalogue(thing: PlantDescription | Plant) -> dict[str, dict[str, str]]:
    """Return the effects that a plant's model may lack, as effect -> key in a file -> parameter."""
    if isinstance(thing, Plant):
        return {
            effect.name: {knob.key: knob.parameter for knob in effect.knobs}
            for effect in thing.effects.values()
        }
    return {effect.name: dict(effect.parameters) for effect in thing.effects}


def own_parameters(thing: PlantDescription | Plant) -> list[Parameter]:
    """Return the parameters that a file gives under `parameters`.

    These are the ones without a neutral value, and the ones that belong to no effect.
    """
    moved = {name for keys in catalogue(thing).values() for name in keys.values()}
    known = thing.own_parameters if isinstance(thing, Plant) else thing.parameters
    return [p for p in known if p.neutral is None or p.name not in moved]


def read_plant_file(
    path: Path, thing: PlantDescription | Plant, recordings: Sequence[str | Path] = ()
) -> PlantModel:
    """Return a plant, or the plant of a description, with the values of a model file.

    A description becomes a plant of the period that the file gives, else of one that fits the first
    of the recordings that can be read, else of 1 ms.

    Raises:
        ConfigError: lists every problem of the file.
        PlantError: lists every problem of the description.
    """
    if isinstance(thing, PlantDescription):
        check_description(thing)
    sources = Sources()
    root = sources.read_yaml(path.resolve())
    sources.problems.raise_if_any()
    assert root is not None
    reading = _Reading(thing, sources)
    file = read_mapping(_File, root, sources.problems)
    values = reading.values(root)
    columns, outputs = reading.channels(root)
    tolerances = reading.shares(root, "tolerances", [p.name for p in thing.parameters])
    errors = reading.errors(root)
    steering = reading.steering(root)
    if isinstance(thing, PlantDescription) and root.get("tolerances") is not None:
        thing = replace(thing, tolerances=tolerances)
    additions = read_additions(root, vocabulary(thing), sources.problems)
    sources.problems.raise_if_any()
    assert file is not None
    rows = None
    if isinstance(thing, Plant):
        if file.period is not None and abs(file.period / thing.period - 1.0) > 1e-6:
            place = root.find(("period",))
            limit = f"the module has the plant in full, for {thing.period * 1e3:g} ms"
            sources.problems.add(place.place, "period", shown(place), limit, "delete it")
            sources.problems.raise_if_any()
        changed: Any = {"nuisances": nuisances(thing.parameters, tolerances, values)}
        plant = replace(
            thing, nominal=values, outputs=outputs, **(changed if tolerances else {}),
            steering=thing.steering if steering is None else tuple(
                (thing.inputs.index(pair[0]), [o.channel for o in outputs].index(pair[1]), gain)
                for pair, gain in steering.items()
            ),
        )  # fmt: skip
    else:
        described = replace(
            thing,
            outputs=outputs,
            equations=tuple(
                replace(each, error=errors.get(each.name, each.error)) for each in thing.equations
            ),
            steering=thing.steering if steering is None else steering,
        )
        rows = next(filter(None, (read_sampling(each, columns) for each in recordings)), None)
        period = file.period or (1e-3 if rows is None else rows.grid)
        plant = build(described, values, period, period if rows is None else rows.period)
    plant = _holding(plant, additions, root, sources)
    effects = tuple(name for name, _ in reading.switched_on(root))
    row_s = None
    if file.period is None and not isinstance(thing, Plant):
        row_s = plant.period if rows is None else rows.period
    return PlantModel(file.name, plant, columns, effects, root.plain(), row_s)


def _holding(plant: Plant, additions: Sequence[Addition], root: Located, sources: Sources) -> Plant:
    """Return the plant with the additions that the file gives.

    Raises:
        ConfigError: models of the plant hold none of them.
    """
    if not additions:
        return plant
    layout = plant.layout
    if layout is None:
        section = root.find((KEY,))
        limit = "cannot be held"
        remedy = plant.why_no_layout or "delete it: models of this plant hold no additions"
        sources.problems.add(section.place, section.name, "", limit, remedy)
        sources.problems.raise_if_any()
    else:
        plant = replace(plant, nominal={**plant.nominal, **layout.values(additions)})
    return plant


class _Reading:
    """A reader of the sections of one file, which adds the mistakes to the sources' problems."""

    def __init__(self, thing: PlantDescription | Plant, sources: Sources) -> None:
        self.thing, self.problems = thing, sources.problems
        self.known = {parameter.name: parameter for parameter in thing.parameters}
        self.effects = catalogue(thing)

    def _checked(
        self, item: Located, fields: Mapping[str, Any], hints: dict[str, str] | None = None
    ) -> dict[str, Any]:
        return checked(item, fields, self.problems, hints)

    def _input_units(self) -> dict[str, str]:
        """Return the unit of each input by its channel; empty if the unit is not known."""
        inputs = self.thing.inputs
        return {
            **{each: "" for each in inputs if isinstance(each, str)},
            **{each.channel: each.unit for each in inputs if not isinstance(each, str)},
        }

    def _physical(self, name: str) -> Any:
        each = self.known[name]
        return Annotated[Any, Physical(each.unit, each.lower, each.upper)]

    # Values

    def values(self, root: Located) -> dict[str, float]:
        """Return the values of all parameters by name, in SI; NaN where one is missing."""
        neutral = {p.name: p.neutral for p in self.thing.parameters}
        values: dict[str, float] = {k: v for k, v in neutral.items() if v is not None}
        own = own_parameters(self.thing)
        section = root.get("parameters")
        under_effects = self._effect_values(root)
        if section is not None:
            hints = {
                name: f"set it under effects: {{{effect}: ...}}"
                for effect, keys in self.effects.items()
                for name in keys.values()
            }
            read = self._checked(section, {p.name: self._physical(p.name) for p in own}, hints)
            found = {name: float(value) for name, value in read.items() if value is not None}
            for name, value in found.items():
                if name in under_effects:
                    self.problems.add(
                        section.find((name,)).place, name, shown(section.find((name,))),
                        "is given under effects too", "keep one of them",
                    )  # fmt: skip
                values[name] = value
            for each in own:
                if each.neutral is None and each.name not in {*found, *under_effects}:
                    self._lacking(section, each)
        values.update(under_effects)
        return {name: values.get(name, float("nan")) for name in self.known}

    def _lacking(self, section: Located, each: Parameter) -> None:
        entry = section.find((each.name,))
        if self.problems.has_at(entry.place) and entry is not section:
            return
        about = f" ({each.about})" if each.about else ""
        example = f"{each.name}: ... {each.unit}".rstrip()
        remedy = f"add `{example}`{about}"
        self.problems.add(section.place, "parameters", "", f"lacks {each.name}", remedy)

    def switched_on(self, root: Located) -> list[tuple[str, Located]]:
        """Return the effects that the file switches on, each with its entry in the file."""
        section = root.get("effects")
        if section is None:
            return []
        return [
            (name, entry)
            for name, entry in section.items()
            if name in self.effects and entry.value not in (None, "none")
        ]

    def _effect_values(self, root: Located) -> dict[str, float]:
        section = root.get("effects")
        if section is not None:
            self._checked(section, dict.fromkeys(self.effects, Any))
        values: dict[str, float] = {}
        for name, entry in self.switched_on(root):
            keys = self.effects[name]
            if not isinstance(entry.value, dict) and "value" in keys:
                entry = Located({"value": entry}, entry.place, entry.name)
            found = self._checked(entry, {k: self._physical(p) for k, p in keys.items()})
            values |= {keys[key]: float(v) for key, v in found.items() if v is not None}
        return values

    # Recordings

    def channels(self, root: Located) -> tuple[dict[str, Column], Any]:
        """Return the column of each channel that the file names, and the outputs.

        The outputs have the noise, resolution and range that the file gives them.
        """
        section = root.get("channels")
        outputs = {output.channel: output for output in self.thing.outputs}
        if section is None:
            return {}, self.thing.outputs
        inputs = self._input_units()
        self._checked(section, dict.fromkeys((TIME, *inputs, *outputs), Any))
        columns: dict[str, Column] = {}
        for name, entry in section.items():
            if name in outputs:
                unit = outputs[name].unit
                kinds = {
                    key: Annotated[Any, Physical(unit, lower)]
                    for key, lower in (("noise", 1e-300), ("resolution", 0.0), ("lower", -inf),
                                       ("upper", -inf))
                }  # fmt: skip
                columns[name], found = column_in(name, entry, unit, self.problems, kinds)
                given = {key: found[key] for key in kinds if found.get(key) is not None}
                outputs[name] = replace(outputs[name], **given)
            elif name == TIME or name in inputs:
                unit = "s" if name == TIME else inputs[name]
                columns[name], _ = column_in(name, entry, unit, self.problems, {})
        return columns, tuple(outputs.values())

    # Allowed errors

    def shares(self, root: Located, key: str, names: list[str]) -> dict[str, float]:
        """Return the fractions that the section `key` gives, by name; {} if it is missing."""
        section = root.get(key)
        if section is None:
            return {}
        found = self._checked(section, dict.fromkeys(names, Annotated[Any, Physical("", 0.0)]))
        return {name: float(value) for name, value in found.items() if value is not None}

    def errors(self, root: Located) -> dict[str, float]:
        """Return the model errors that the file gives, by equation, in the equation's unit."""
        section = root.get("model_error")
        if section is None:
            return {}
        if isinstance(self.thing, Plant):
            self.problems.add(
                section.place, "model_error", shown(section), "is not for a plant made in full",
                "set the noise of its states in the module",
            )  # fmt: skip
            return {}
        found: dict[str, float] = {}
        equations = {each.name: each for each in self.thing.equations}
        self._known_keys(section, list(equations))
        for name, entry in section.items():
            if name in equations:
                value = self._quantity(entry, equations[name].unit, 0.0)
                if value is not None:
                    found[name] = value
        return found

    def _known_keys(self, section: Located, names: list[str]) -> None:
        # A schema cannot check this, as names with spaces cannot be its fields.
        if not isinstance(section.value, dict):
            self.problems.add(section.place, section.name, shown(section), "is not a mapping",
                              f"keys: {', '.join(names)}")  # fmt: skip
        for name, entry in section.items():
            if name not in names:
                self.problems.add(entry.place, name, "", "is not a known key",
                                  suggestion(name, names, "keys"))  # fmt: skip

    def _quantity(self, entry: Located, unit: str, lower: float = -inf) -> float | None:
        return quantity_in(entry, lambda: Physical(unit, lower).parse(entry.value), self.problems)

    def steering(self, root: Located) -> dict[tuple[str, str], float] | None:
        """Return the gain from each input to each output that it steers.

        Return None if the file does not have the section, {} if it says "none".
        """
        section = root.get("steering")
        if section is None:
            return None
        if section.value == "none":
            return {}
        units = self._input_units()
        outputs = {output.channel: output.unit for output in self.thing.outputs}
        self._known_keys(section, list(units))
        gains: dict[tuple[str, str], float] = {}
        for name, entry in section.items():
            if name not in units:
                continue
            self._known_keys(entry, list(outputs))
            for channel, gain in entry.items():
                if channel in outputs:
                    unit = f"{units[name]}/{outputs[channel]}" if units[name] else ""
                    value = self._quantity(gain, unit)
                    if value is not None:
                        gains[name, channel] = value
        return gains


def write_plant_file(
    model: PlantModel, values: Mapping[str, float], effects: tuple[str, ...], provenance: Any,
    path: Path,
) -> None:  # fmt: skip
    """Write a model file with new values of all parameters, which reads back to the same floats.

    The file switches on the model's effects and the added ones. Intervals in the provenance
    (`effects`, `refitted`: key -> value, lower, upper) are written as comments beside the values
    too, unless a refitted value was not kept (`kept` is false). If values or effects changed, the
    word "revised" is appended to the model's name, once.

    Args:
        model: the model as it was read.
        values: values of all parameters by name, SI.
        effects: names of the added effects.
        provenance: where the values come from.
        path: path of the file, which is replaced.

    Raises:
        OSError: the file cannot be written.
    """
    names = [*model.effects, *(name for name in effects if name not in model.effects)]
    on = {name: keys for name, keys in catalogue(model.plant).items() if name in names}
    written = _Values(values, model.plant.parameters, provenance)
    same = dict(values) == model.plant.nominal and not effects
    revised = same or model.name.endswith(f" {REVISED}")
    name = model.name if revised else f"{model.name} {REVISED}"
    header = {"name": name, "description": model.content.get("description")}
    lines = [_dumped({key: value for key, value in header.items() if value})]
    lines += ["parameters:"]
    under_effects = {parameter for keys in on.values() for parameter in keys.values()}
    for each in own_parameters(model.plant):
        if each.name not in under_effects:
            lines.append(written.line("  ", each.name, each.name, written.refitted.get(each.name)))
    if on:
        lines.append("effects:")
    for effect, keys in on.items():
        intervals = written.intervals(effect)
        if list(keys) == ["value"]:
            lines.append(written.line("  ", effect, keys["value"], intervals.get("value")))
            continue
        lines.append(f"  {effect}:")
        lines += [written.line("    ", k, p, intervals.get(k)) for k, p in keys.items()]
    lines += written_additions(model.plant, values)
    lines += _carried(model.content)
    if provenance:
        lines.append(_dumped({"provenance": plain_provenance(provenance)}))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


class _Values:
    """A writer of lines with a value, its unit, its meaning and its interval."""

    def __init__(
        self, values: Mapping[str, float], parameters: tuple[Parameter, ...], provenance: Any
    ) -> None:
        self.values = values
        self.known = {parameter.name: parameter for parameter in parameters}
        self.provenance = provenance if isinstance(provenance, Mapping) else {}
        refitted: Mapping[str, Any] = self.provenance.get("refitted") or {}
        self.refitted = {key: each for key, each in refitted.items() if each.get("kept", True)}

    def intervals(self, effect: str) -> Mapping[str, Any]:
        found = (self.provenance.get("effects") or {}).get(effect) or {}
        return dict(found.get("parameters") or {})

    def line(self, indent: str, key: str, parameter: str, interval: Any) -> str:
        each = self.known[parameter]
        text = f"{indent}{key}: {float(self.values[parameter])!r} {each.unit}".rstrip()
        comment = [each.about] if each.about else []
        ends = [interval.get(end) for end in ("lower", "upper")] if interval else []
        if ends and None not in ends:
            comment.append(f"95 %: {ends[0]:.6g} to {ends[1]:.6g} {each.unit}".rstrip())
        return f"{text:<{_COMMENT_COLUMN}} # {'; '.join(comment)}" if comment else text


def _carried(content: Mapping[str, Any]) -> Iterator[str]:
    """Yield, as YAML, the sections of the old file that a revision does not change."""
    for key in _CARRIED:
        if content.get(key) is not None:
            yield _dumped({key: content[key]})


def _dumped(content: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100).rstrip()
