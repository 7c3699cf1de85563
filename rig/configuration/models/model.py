"""Model files: parameters with units, the effects switched on, and where the model comes from."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import create_model

from rig.configuration.reading import (
    Adjustable,
    Field,
    Located,
    Physical,
    Problems,
    Relative,
    Schema,
    Sources,
    load,
    read_mapping,
    resolve_in,
    show,
    shown,
)
from rig.plant import (
    CATALOGUE,
    FRICTION_LAWS,
    NOMINAL,
    EffectParameter,
    Model,
    PlantEffect,
    quantities,
)

from .discovered import KEY, OLD_KEY, Terms, read_terms

MAX_ANCESTORS: Final = 16

_QUANTITIES: Final = quantities()
_EFFECT_OF: Final = {
    parameter.field: (effect.name, parameter.name)
    for effect in CATALOGUE.values()
    for parameter in effect.parameters
}


SHIFTABLE: Final = frozenset(
    parameter.field
    for effect in CATALOGUE.values()
    for parameter in effect.parameters
    if parameter.shift
)
"""Parameters that every rig has and that an effect may shift.

A file may give each of them under `parameters` or under `effects`, but not under both.
"""
PARAMETERS: Final = tuple(
    name
    for name in _QUANTITIES
    if name != "friction_law" and (name not in _EFFECT_OF or name in SHIFTABLE)
)


def physical(field: str) -> Physical:
    """Return unit, limits and usual value of a plant's parameter; 0 does not count as usual."""
    quantity = _QUANTITIES[field]
    usual = getattr(NOMINAL, field) or None
    return Physical(quantity.unit, quantity.lower, quantity.upper, usual)


class ParameterSchemas(NamedTuple):
    """The schemas of the sections `parameters` and `effects`, and of each effect by its name."""

    parameters: type[Schema]
    effects: type[Schema]
    effect: dict[str, type[Schema]]


def parameter_schemas(field_of: Callable[[Physical], Field]) -> ParameterSchemas:
    """Return the schemas of a file that gives parameters of the plant.

    `field_of` makes, from a parameter's unit and limits, the field that parses its value.
    """

    def schema(name: str, fields: dict[str, str]) -> type[Schema]:
        definitions: dict[str, Any] = {
            key: (Annotated[Any, field_of(physical(field))], None) for key, field in fields.items()
        }
        return create_model(name, __base__=Schema, **definitions)

    effects: dict[str, Any] = dict.fromkeys(CATALOGUE, (Any, None))
    return ParameterSchemas(
        schema("ParametersFile", {name: name for name in PARAMETERS}),
        create_model("EffectsFile", __base__=Schema, **effects),
        {
            effect.name: schema(effect.name, {p.name: p.field for p in effect.parameters})
            for effect in CATALOGUE.values()
        },
    )


def effect_values(
    effect: PlantEffect, entry: Located, alone: bool, schemas: ParameterSchemas, problems: Problems
) -> list[tuple[EffectParameter, Any, Located]]:
    """Return each parameter of an effect with its value and its place in the file.

    A value is None if it is wrong or missing. If no parameter is given, the list is empty and a
    problem is recorded.

    Args:
        effect: an effect of the catalogue.
        entry: the file's entry for the effect.
        alone: whether the entry is the value itself, rather than a mapping of parameters.
        schemas: schemas of the file.
        problems: takes the mistakes.
    """
    names = [parameter.name for parameter in effect.parameters]
    if alone and "value" in names:
        entry = Located({"value": entry}, entry.place, entry.name)
    elif alone or not entry.value:
        limit, remedy = "lacks its parameters", f"give {{{', '.join(names)}}}"
        problems.add(entry.place, effect.name, shown(entry), limit, remedy)
        return []
    file = read_mapping(schemas.effect[effect.name], entry, problems)
    return [(p, getattr(file, p.name, None), entry.find((p.name,))) for p in effect.parameters]


class ModelFile(Schema):
    """Keys of a model file."""

    name: str
    description: str = ""
    parent: str | None = None
    parameters: Any = None
    friction_law: Literal["bristle", "karnopp"] | None = None
    effects: Any = None
    discovered: Any = None
    unknown_term: Any = None
    provenance: Any = None


_SCHEMAS: Final = parameter_schemas(Adjustable)
BELONGS_TO_EFFECT: Final = {
    field: f"set it under effects: {{{effect}: ...}}"
    if key == "value"
    else f"set it under effects: {{{effect}: {{{key}: ...}}}}"
    for field, (effect, key) in _EFFECT_OF.items()
    if field not in SHIFTABLE
}


def read_model(path: Path, sources: Sources, ancestors: tuple[Path, ...] = ()) -> Model | None:
    """Return the model in a file, with what it takes over from its parents.

    Return None if the file is unusable. Problems are added to those of `sources`; where only a
    value is wrong, a model with the parent's value is returned. `ancestors` are the files that name
    this one as parent, directly or not.
    """
    root = sources.read_yaml(path)
    if root is None:
        return None
    return model_from(root, sources, (*ancestors, path))


def model_from(root: Located, sources: Sources, ancestors: tuple[Path, ...]) -> Model | None:
    """Return the model that a mapping describes; None if it is unusable.

    The mapping was read from the last file of `ancestors`, and each of these files is the parent of
    the one before it.
    """
    file = read_mapping(ModelFile, root, sources.problems)
    parent = _parent(root, sources, ancestors)
    base = parent or Model()
    model = override(base, root, sources)
    if file is None or (parent is None and root.get("parent") is not None):
        return None
    provenance = root.get("provenance")
    given = provenance.plain() if provenance else {}
    if not isinstance(given, dict):
        sources.problems.add(
            root.find(("provenance",)).place, "provenance", given, "is not a mapping", "give keys"
        )
        return None
    return replace(model, name=file.name, provenance=given)


def _parent(root: Located, sources: Sources, ancestors: tuple[Path, ...]) -> Model | None:
    entry = root.get("parent")
    path = resolve_in("model", entry, sources.problems)
    if entry is None or path is None:
        return None
    if path in ancestors or len(ancestors) > MAX_ANCESTORS:
        limit, remedy = "descends from this model", "name another parent"
        sources.problems.add(entry.place, "parent", entry.value, limit, remedy)
        return None
    return read_model(path, sources, ancestors)


def override(base: Model, item: Located, sources: Sources) -> Model:
    """Return `base` changed by the keys parameters, friction_law, effects, discovered of `item`.

    Where a value is wrong, the base's value stays and a problem is recorded. An effect that the
    file sets to nothing or "none" is switched off, and its parameters become those of `NOMINAL`.
    """
    changes = _Overrides(base, sources)
    parameters, effects, law = (item.get(key) for key in ("parameters", "effects", "friction_law"))
    if parameters is not None:
        changes.apply_parameters(parameters)
    if law is not None and isinstance(law.value, str) and law.value in FRICTION_LAWS:
        changes.values["friction_law"] = FRICTION_LAWS[law.value]
    if effects is not None:
        changes.apply_effects(effects)
        changes.let_follow(effects)
    terms = _terms(item, sources)
    if terms is not None:
        changes.values |= terms.fields
    model = replace(
        base,
        parameters=base.parameters._replace(**changes.values),
        effects=tuple(changes.effects),
        discovered=base.discovered if terms is None else terms.others,
    )
    _check_together(model, item, set(changes.values), sources)
    return model


def _terms(item: Located, sources: Sources) -> Terms | None:
    """Return the terms that a file gives; None if it gives none that can be used."""
    now, older = item.get(KEY), item.get(OLD_KEY)
    if now is not None and older is not None:
        limit, remedy = f"is the older name of {KEY}, which is given too", "keep one of them"
        sources.problems.add(older.place, OLD_KEY, shown(older), limit, remedy)
    section = now or older
    return None if section is None else read_terms(section, sources)


@dataclass
class _Overrides:
    """A collection of the parameter fields and the effects that a file changes in a base model."""

    base: Model
    sources: Sources

    def __post_init__(self) -> None:
        self.values: dict[str, float] = {}
        self.effects: list[str] = list(self.base.effects)

    def apply_parameters(self, item: Located) -> None:
        file = read_mapping(_SCHEMAS.parameters, item, self.sources.problems, BELONGS_TO_EFFECT)
        for field in PARAMETERS:
            self._set(field, getattr(file, field, None), item.find((field,)))

    def apply_effects(self, item: Located) -> None:
        read_mapping(_SCHEMAS.effects, item, self.sources.problems)
        for name, entry in item.items():
            if name not in CATALOGUE:
                continue
            if entry.value in (None, "none"):
                self._switch_off(name)
            else:
                self._switch_on(name, entry)

    def _switch_on(self, name: str, entry: Located) -> None:
        alone = not isinstance(entry.value, dict)
        given = effect_values(CATALOGUE[name], entry, alone, _SCHEMAS, self.sources.problems)
        for parameter, value, place in given:
            self._set(parameter.field, value, place)
        if given and name not in self.effects:
            self.effects.append(name)

    def let_follow(self, item: Located) -> None:
        """Set each parameter that follows one which an effect shifts, unless the file gives it."""
        for name in item.value if isinstance(item.value, dict) else ():
            for parameter in CATALOGUE[name].parameters if name in CATALOGUE else ():
                follower, base = parameter.followed_by, self.base.parameters
                value = self.values.get(parameter.field)
                if follower and follower not in self.values and value is not None:
                    followed = CATALOGUE[name].applied(base, **{parameter.name: value})
                    self.values[follower] = getattr(followed, follower)

    def _switch_off(self, name: str) -> None:
        for parameter in CATALOGUE[name].parameters:
            self.values[parameter.field] = getattr(NOMINAL, parameter.field)
        self.effects = [effect for effect in self.effects if effect != name]

    def _set(self, field: str, value: float | Relative | None, item: Located) -> None:
        if isinstance(value, Relative):
            value = self._deviated(field, value, item)
        if value is None:
            return
        if field in self.values and field in SHIFTABLE:
            self.sources.problems.add(
                item.place, field, shown(item), "is given as a parameter too", "keep one of them"
            )
            return
        self.values[field] = value

    def _deviated(self, field: str, deviation: Relative, item: Located) -> float | None:
        quantity, base = _QUANTITIES[field], getattr(self.base.parameters, field)
        value = base * (1.0 + deviation.fraction)
        problems = self.sources.problems
        if base == 0.0:
            example = show(quantity.upper, quantity.unit)
            remedy = f"give the value itself, at most {example}"
            problems.add(item.place, item.name, shown(item), "is a share of zero", remedy)
            return None
        for limit, beyond in ((quantity.upper, "above"), (quantity.lower, "below")):
            if (value - limit) * (1.0 if beyond == "above" else -1.0) > 0.0:
                text = f"gives {show(value, quantity.unit)}, {beyond} {show(limit, quantity.unit)}"
                remedy = f"deviate less from {show(base, quantity.unit)}"
                problems.add(item.place, item.name, shown(item), text, remedy)
                return None
        return float(value)


def _check_together(model: Model, item: Located, changed: set[str], sources: Sources) -> None:
    """Record a problem for each pair of contradicting parameters of which one is in `changed`."""
    par = model.parameters
    rules = (
        ("stroke_max", "stroke_min", "m", par.stroke_max > par.stroke_min),
        ("supply_pressure", "return_pressure", "Pa", par.supply_pressure > par.return_pressure),
        ("stiction", "coulomb", "N", par.stiction >= par.coulomb),
    )
    for larger, smaller, unit, holds in rules:
        if holds or not changed & {larger, smaller}:
            continue
        field, other = (larger, smaller) if larger in changed else (smaller, larger)
        section = "parameters" if item.find(("parameters", field)).name == field else "effects"
        value, limit = (show(getattr(par, name), unit) for name in (field, other))
        relation = "is below" if field == larger else "is above"
        sources.problems.add(
            item.find((section, field)).place,
            field,
            value,
            f"{relation} {other} ({limit})",
            f"correct {field} or {other}",
        )


def load_model(reference: str | Path, base: Path | None = None) -> Model:
    """Return the model that a path or a name means, with what it takes over from its parents.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file and its parents.
    """
    return load("model", reference, base, read_model)
