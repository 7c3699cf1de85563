"""Model files of plants that a user describes in Python are read and written here.

Such a file has the plant's values, its channels, and by how much the model may be wrong. The plant
itself, with its equations and effects, is a Python module (`plant_loading`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import inf, nan
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
    checked,
    quantity_in,
    read_mapping,
    suggestion,
)
from rig.recording import Column, Recording, RecordingError, read_measured, read_sampling

from .additions import read_additions, vocabulary, written_additions
from .columns import TIME, column_in
from .discovered import KEY
from .model_writing import commented, plain_provenance, section_lines

ALIKE: Final = 0.1
"""Greatest difference of a recording's period from that of the others, as a part of it."""
REVISED: Final = "revised"
_CARRIED: Final = ("period", "channels", "tolerances", "model_error", "steering")
_LOWEST: Final = {"noise": 1e-300, "resolution": 0.0, "lower": -inf, "upper": -inf}
"""Keys of an output, with the smallest value that each may have, in the output's unit."""


@dataclass(frozen=True)
class PlantModel:
    """A plant with the values of its model file, and the columns of its recordings.

    Attributes:
        name: name of the model.
        plant: the plant, as the gap workflow uses it.
        columns: channel -> column of a recording, for channels that have another name or unit
            there.
        effects: names of the effects that the model file switches on.
        content: the model file as plain dicts, lists and scalars.
        row_s: period in s that the rows of its recordings must have; None if any will do.
    """

    name: str
    plant: Plant
    columns: Mapping[str, Column]
    effects: tuple[str, ...]
    content: Mapping[str, Any] = field(repr=False)
    row_s: float | None = None

    def read(self, path: str | Path) -> Recording:
        """Return the recording in a file as samples of the plant's period, in SI.

        The channels have the plant's names. Rows of another period are brought to the plant's.

        Raises:
            RecordingError: lists every problem of the file. A period of the rows that is more than
                10 % off `row_s` is one.
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
    """Return the effects that a plant's model may have: effect -> key in a file -> parameter."""
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
    root = sources.finished(sources.read_yaml(path.resolve()))
    file = read_mapping(_File, root)
    values = _values_in(root, thing)
    columns, outputs = _channels(root.get("channels"), thing)
    tolerances = _tolerances(root.get("tolerances"), thing)
    errors = _errors(root.get("model_error"), thing)
    steering = _steering(root.get("steering"), thing)
    if isinstance(thing, PlantDescription) and root.get("tolerances") is not None:
        thing = replace(thing, tolerances=tolerances)
    additions = read_additions(root, vocabulary(thing))
    file = sources.finished(file)
    row_s = None
    if isinstance(thing, Plant):
        if file.period is not None and abs(file.period / thing.period - 1.0) > 1e-6:
            limit = f"the module has the plant in full, for {thing.period * 1e3:g} ms"
            root.refuse(limit, "delete it", key="period")
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
        if file.period is None:
            row_s = plant.period if rows is None else rows.period
    plant = _holding(plant, additions, root)
    effects = tuple(_switched_on(root, catalogue(thing)))
    return PlantModel(file.name, plant, columns, effects, root.plain(), row_s)


def _holding(plant: Plant, additions: Sequence[Addition], root: Located) -> Plant:
    """Return the plant with the additions that the file gives among its nominal values.

    Raises:
        ConfigError: there are additions, and models of this plant cannot hold any.
    """
    if not additions:
        return plant
    if plant.layout is None:
        remedy = plant.why_no_layout or "delete it: models of this plant hold no additions"
        root.refuse("cannot be held", remedy, "", KEY)
        root.sources.problems.raise_if_any()
    assert plant.layout is not None
    return replace(plant, nominal={**plant.nominal, **plant.layout.values(additions)})


def _limits(parameter: Parameter) -> Any:
    return Annotated[Any, Physical(parameter.unit, parameter.lower, parameter.upper)]


def _values_in(root: Located, thing: PlantDescription | Plant) -> dict[str, float]:
    """Return the values of all parameters by name, in SI; record the problems.

    A parameter that the file does not give has its neutral value, or NaN if it has none.
    """
    values = {p.name: nan if p.neutral is None else p.neutral for p in thing.parameters}
    section, own = root.get("parameters"), own_parameters(thing)
    under_effects = _effect_values(root, thing)
    if section is not None:
        hints = {
            name: f"set it under effects: {{{effect}: ...}}"
            for effect, keys in catalogue(thing).items()
            for name in keys.values()
        }
        read = checked(section, {p.name: _limits(p) for p in own}, hints)
        found = {name: float(value) for name, value in read.items() if value is not None}
        for name in found:
            if name in under_effects:
                section.refuse("is given under effects too", "keep one of them", key=name)
        values |= found
        for each in own:
            if each.neutral is None and each.name not in {*found, *under_effects}:
                _add_lacking(section, each)
    return values | under_effects


def _add_lacking(section: Located, parameter: Parameter) -> None:
    entry = section.find(parameter.name)
    if entry is not section and section.sources.problems.has_at(entry.place):
        return
    about = f" ({parameter.about})" if parameter.about else ""
    example = f"{parameter.name}: ... {parameter.unit}".rstrip()
    section.refuse(f"lacks {parameter.name}", f"add `{example}`{about}", "")


def _switched_on(root: Located, known: Mapping[str, Any]) -> dict[str, Located]:
    """Return those of the known effects that the file switches on, with its entry for each."""
    section = root.get("effects")
    return {
        name: entry
        for name, entry in (section.items() if section is not None else ())
        if name in known and entry.value not in (None, "none")
    }


def _effect_values(root: Located, thing: PlantDescription | Plant) -> dict[str, float]:
    effects, limits = catalogue(thing), {p.name: _limits(p) for p in thing.parameters}
    section = root.get("effects")
    if section is not None:
        checked(section, dict.fromkeys(effects, Any))
    values: dict[str, float] = {}
    for name, entry in _switched_on(root, effects).items():
        keys = effects[name]
        if not isinstance(entry.value, dict) and "value" in keys:
            entry = entry.with_value({"value": entry})
        found = checked(entry, {key: limits[parameter] for key, parameter in keys.items()})
        values |= {keys[key]: float(v) for key, v in found.items() if v is not None}
    return values


def _input_units(thing: PlantDescription | Plant) -> dict[str, str]:
    """Return channel of each input -> its unit, which is "" if it is not known."""
    return {
        **{each: "" for each in thing.inputs if isinstance(each, str)},
        **{each.channel: each.unit for each in thing.inputs if not isinstance(each, str)},
    }


def _channels(
    section: Located | None, thing: PlantDescription | Plant
) -> tuple[dict[str, Column], Any]:
    """Return the column of each channel that the section `channels` names, and all outputs.

    The outputs have the noise, resolution and range that the file gives them, else the plant's.
    """
    if section is None:
        return {}, thing.outputs
    outputs = {output.channel: output for output in thing.outputs}
    units = {TIME: "s", **_input_units(thing)}
    checked(section, dict.fromkeys((*units, *outputs), Any))
    columns: dict[str, Column] = {}
    for name, entry in section.items():
        if name in outputs:
            unit = outputs[name].unit
            kinds = {key: Annotated[Any, Physical(unit, low)] for key, low in _LOWEST.items()}
            columns[name], found = column_in(name, entry, unit, kinds)
            given = {key: found[key] for key in kinds if found.get(key) is not None}
            outputs[name] = replace(outputs[name], **given)
        elif name in units:
            columns[name], _ = column_in(name, entry, units[name])
    return columns, tuple(outputs.values())


def _tolerances(section: Located | None, thing: PlantDescription | Plant) -> dict[str, float]:
    """Return parameter -> fraction of its value by which it may be wrong, as the file says.

    The result is empty if the file gives none.
    """
    if section is None:
        return {}
    share = Annotated[Any, Physical("", 0.0)]
    found = checked(section, {parameter.name: share for parameter in thing.parameters})
    return {name: float(value) for name, value in found.items() if value is not None}


def _errors(section: Located | None, thing: PlantDescription | Plant) -> dict[str, float]:
    """Return equation -> its model error in the equation's unit, for those that the file gives.

    For a plant in full, which has no such errors, record a problem and return {}.
    """
    if section is None:
        return {}
    if isinstance(thing, Plant):
        remedy = "set the noise of its states in the module"
        section.refuse("is not for a plant made in full", remedy)
        return {}
    return _quantities(section, {each.name: each.unit for each in thing.equations}, 0.0)


def _quantities(
    section: Located, units: Mapping[str, str], lower: float = -inf
) -> dict[str, float]:
    """Return the quantities in a mapping with the keys of `units`; record the problems.

    A schema cannot check this, as names with spaces cannot be its fields.
    """
    found = {
        name: quantity_in(entry, partial(Physical(units[name], lower).parse, entry.value))
        for name, entry in _known(section, list(units))
    }
    return {name: value for name, value in found.items() if value is not None}


def _known(section: Located, names: Sequence[str]) -> list[tuple[str, Located]]:
    """Return the entries of a mapping that have one of these names; record the others."""
    if not isinstance(section.value, dict):
        section.refuse("is not a mapping", f"keys: {', '.join(names)}")
    for name, entry in section.items():
        if name not in names:
            entry.refuse("is not a known key", suggestion(name, names, "keys"), "")
    return [(name, entry) for name, entry in section.items() if name in names]


def _steering(
    section: Located | None, thing: PlantDescription | Plant
) -> dict[tuple[str, str], float] | None:
    """Return (input, output) -> gain of the feedback from the output, as `PlantDescription` has it.

    The gain is in the input's unit per the output's. Return None if the file does not have the
    section, {} if it says "none".
    """
    if section is None:
        return None
    if section.value == "none":
        return {}
    inputs = _input_units(thing)
    gains: dict[tuple[str, str], float] = {}
    for name, entry in _known(section, list(inputs)):
        units = {
            output.channel: f"{inputs[name]}/{output.unit}" if inputs[name] else ""
            for output in thing.outputs
        }
        gains |= {(name, channel): gain for channel, gain in _quantities(entry, units).items()}
    return gains


def write_plant_file(
    model: PlantModel, values: Mapping[str, float], effects: tuple[str, ...], provenance: Any,
    path: Path,
) -> None:  # fmt: skip
    """Write a model file with new values of all parameters, which reads back to the same floats.

    The file switches on the model's effects and the added ones. Intervals in the provenance (under
    `effects` and `refitted`, each with `lower` and `upper`) are written as comments beside the
    values too, unless a refitted value was not kept (`kept` is false). If a value changed or an
    effect was added, the word "revised" is appended to the model's name, unless it ends so already.

    Args:
        model: the model as it was read.
        values: values of all parameters by name, SI.
        effects: names of the added effects.
        provenance: where the values come from.
        path: path of the file, which is replaced.

    Raises:
        OSError: the file cannot be written.
    """
    names = {*model.effects, *effects}
    on = {name: keys for name, keys in catalogue(model.plant).items() if name in names}
    known = {parameter.name: parameter for parameter in model.plant.parameters}
    intervals = _intervals(provenance, on)
    same = dict(values) == model.plant.nominal and not effects
    revised = same or model.name.endswith(f" {REVISED}")
    name = model.name if revised else f"{model.name} {REVISED}"
    header = {"name": name, "description": model.content.get("description")}
    lines = [_dumped({key: value for key, value in header.items() if value})]
    lines += section_lines(
        [parameter.name for parameter in own_parameters(model.plant)],
        on,
        lambda key, name: _line(key, known[name], values[name], intervals.get(name)),
    )
    lines += written_additions(model.plant, values)
    carried = {key: model.content.get(key) for key in _CARRIED}
    lines += [_dumped({key: value}) for key, value in carried.items() if value is not None]
    if provenance:
        lines.append(_dumped({"provenance": plain_provenance(provenance)}))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _intervals(provenance: Any, effects: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Return parameter -> its interval in the provenance, a mapping with `lower` and `upper`.

    The interval is None for a parameter of an effect that was not fitted. `effects` are those that
    are switched on: effect -> key in a file -> parameter.
    """
    given = provenance if isinstance(provenance, Mapping) else {}
    refitted: Mapping[str, Any] = given.get("refitted") or {}
    found = {name: each for name, each in refitted.items() if each.get("kept", True)}
    for effect, keys in effects.items():
        fitted = ((given.get("effects") or {}).get(effect) or {}).get("parameters") or {}
        found |= {name: fitted.get(key) for key, name in keys.items()}
    return found


def _line(key: str, parameter: Parameter, value: float, interval: Any) -> str:
    """Return the line of a parameter: its value with unit, its meaning and its interval."""
    comment = [parameter.about] if parameter.about else []
    ends = [interval.get(end) for end in ("lower", "upper")] if interval else []
    if ends and None not in ends:
        comment.append(f"95 %: {ends[0]:.6g} to {ends[1]:.6g} {parameter.unit}".rstrip())
    return commented(f"{key}: {float(value)!r} {parameter.unit}".rstrip(), "; ".join(comment))


def _dumped(content: Mapping[str, Any]) -> str:
    return yaml.safe_dump(dict(content), sort_keys=False, allow_unicode=True, width=100).rstrip()
