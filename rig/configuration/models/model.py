"""Model files: parameters with units, the effects switched on, and where the model comes from."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Final, Literal

from rig.configuration.reading import (
    Adjustable,
    Field,
    Located,
    Physical,
    Relative,
    Schema,
    checked,
    load,
    read_mapping,
    resolve,
    show,
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
    """Return unit, limits and usual value, in SI, of a plant's parameter.

    The usual value is the nominal one, or None if that is 0.
    """
    quantity = _QUANTITIES[field]
    usual = getattr(NOMINAL, field) or None
    return Physical(quantity.unit, quantity.lower, quantity.upper, usual)


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


BELONGS_TO_EFFECT: Final = {
    field: f"set it under effects: {{{effect}: ...}}"
    if key == "value"
    else f"set it under effects: {{{effect}: {{{key}: ...}}}}"
    for field, (effect, key) in _EFFECT_OF.items()
    if field not in SHIFTABLE
}


def read_model(root: Located, children: tuple[Path, ...] = ()) -> Model | None:
    """Return the model that a file describes, with what it takes over from its parents.

    Return None if the file or its parent is unusable. Problems are recorded; where only a value is
    wrong, a model with the parent's value is returned. `children` are the files that name this one
    as parent, directly or not.
    """
    file = read_mapping(ModelFile, root)
    parent = _parent(root, (*children, root.place.path))
    model = override(parent or Model(), root)
    if file is None or (parent is None and root.get("parent") is not None):
        return None
    provenance = root.get("provenance")
    given = provenance.plain() if provenance else {}
    if not isinstance(given, dict):
        root.refuse("is not a mapping", "give keys", given, "provenance")
        return None
    return replace(model, name=file.name, provenance=given)


def _parent(root: Located, children: tuple[Path, ...]) -> Model | None:
    entry = root.get("parent")
    path = resolve("model", entry)
    if entry is None or path is None:
        return None
    if path in children or len(children) > MAX_ANCESTORS:
        entry.refuse("descends from this model", "name another parent", entry.value)
        return None
    parent = root.sources.read_yaml(path)
    return read_model(parent, children) if parent is not None else None


def override(base: Model, item: Located) -> Model:
    """Return a copy of `base` with the changes that a mapping gives.

    The changes are under the keys parameters, friction_law, effects and discovered of `item`. Where
    a value is wrong, the base's value stays and a problem is recorded. An effect that the file sets
    to nothing or "none" is switched off, and its parameters become those of `NOMINAL`.
    """
    changes = _Overrides(base)
    changes.read(item)
    effects, law = item.get("effects"), item.get("friction_law")
    if law is not None and isinstance(law.value, str) and law.value in FRICTION_LAWS:
        changes.values["friction_law"] = FRICTION_LAWS[law.value]
    if effects is not None:
        changes.let_follow(effects)
    terms = _terms(item)
    if terms is not None:
        changes.values |= terms.fields
    model = replace(
        base,
        parameters=base.parameters._replace(**changes.values),
        effects=tuple(changes.effects),
        discovered=base.discovered if terms is None else terms.others,
    )
    _check_together(model, item, set(changes.values))
    return model


def _terms(item: Located) -> Terms | None:
    """Return the terms that a file gives; None if it has no such key or its section is unusable."""
    now, older = item.get(KEY), item.get(OLD_KEY)
    if now is not None and older is not None:
        older.refuse(f"is the older name of {KEY}, which is given too", "keep one of them")
    section = now or older
    return None if section is None else read_terms(section)


class ParameterReader:
    """A reader of the sections `parameters` and `effects` of a model or of a sweep.

    A derived class says with `field_of` how a value is parsed, takes the values with `set`, and
    reads an effect with `read_effect`.
    """

    def read(self, root: Located) -> None:
        """Read both sections of a file, if it has them; record the problems."""
        parameters, effects = root.get("parameters"), root.get("effects")
        if parameters is not None:
            names = {name: name for name in PARAMETERS}
            given = checked(parameters, self._kinds(names), BELONGS_TO_EFFECT)
            for field, value in given.items():
                self.set(field, value, parameters.find(field))
        if effects is not None:
            checked(effects, dict.fromkeys(CATALOGUE, Any))
            for name, entry in effects.items():
                if name in CATALOGUE:
                    self.read_effect(CATALOGUE[name], entry)

    def _kinds(self, fields: Mapping[str, str]) -> dict[str, Any]:
        """Return key -> annotated type of its value.

        `fields` gives the parameter of each key, from which unit and limits of the value follow.
        """
        return {key: Annotated[Any, self.field_of(physical(name))] for key, name in fields.items()}

    def field_of(self, quantity: Physical) -> Field:
        """Return the field that parses the value of a parameter with this unit and limits."""
        raise NotImplementedError

    def read_effect(self, effect: PlantEffect, entry: Located) -> None:
        """Read the entry of a known effect and take what it gives."""
        raise NotImplementedError

    def set(self, field: str, value: Any, item: Located) -> None:
        """Take the value of the parameter `field`; None, for a missing or wrong one, is ignored.

        `item` is the value in the file, at which a problem is recorded.
        """
        raise NotImplementedError

    def effect_values(
        self, effect: PlantEffect, entry: Located, alone: bool
    ) -> list[tuple[EffectParameter, Any, Located]]:
        """Return each parameter of an effect with its value and its place in the file.

        A value is None if it is wrong or missing. If the entry is empty, or is a bare value while
        no parameter of the effect is called `value`, the list is empty and a problem is recorded.
        `alone` says whether the entry is a bare value rather than a mapping of parameters.
        """
        names = [parameter.name for parameter in effect.parameters]
        if alone and "value" in names:
            entry = entry.with_value({"value": entry})
        elif alone or not entry.value:
            entry.refuse("lacks its parameters", f"give {{{', '.join(names)}}}")
            return []
        given = checked(entry, self._kinds({p.name: p.field for p in effect.parameters}))
        return [(p, given[p.name], entry.find(p.name)) for p in effect.parameters]


class _Overrides(ParameterReader):
    """A collection of the parameter fields and the effects that a file changes in a base model."""

    def __init__(self, base: Model) -> None:
        self.base = base
        self.values: dict[str, float] = {}
        self.effects: list[str] = list(base.effects)

    def field_of(self, quantity: Physical) -> Field:
        return Adjustable(quantity)

    def read_effect(self, effect: PlantEffect, entry: Located) -> None:
        if entry.value in (None, "none"):
            for parameter in effect.parameters:
                self.values[parameter.field] = getattr(NOMINAL, parameter.field)
            self.effects = [name for name in self.effects if name != effect.name]
            return
        given = self.effect_values(effect, entry, not isinstance(entry.value, dict))
        for parameter, value, place in given:
            self.set(parameter.field, value, place)
        if given and effect.name not in self.effects:
            self.effects.append(effect.name)

    def let_follow(self, item: Located) -> None:
        """Scale each parameter that follows a shifted one (`followed_by`) as that is scaled.

        A parameter that the file gives itself is left as it is. `item` is the section `effects`.
        """
        for name, _ in item.items():
            for parameter in CATALOGUE[name].parameters if name in CATALOGUE else ():
                follower, base = parameter.followed_by, self.base.parameters
                value = self.values.get(parameter.field)
                if follower and follower not in self.values and value is not None:
                    followed = CATALOGUE[name].applied(base, **{parameter.name: value})
                    self.values[follower] = getattr(followed, follower)

    def set(self, field: str, value: float | Relative | None, item: Located) -> None:
        if isinstance(value, Relative):
            value = self._deviated(field, value, item)
        if value is None:
            return
        if field in self.values and field in SHIFTABLE:
            item.refuse("is given as a parameter too", "keep one of them", name=field)
            return
        self.values[field] = value

    def _deviated(self, field: str, deviation: Relative, item: Located) -> float | None:
        quantity, base = _QUANTITIES[field], getattr(self.base.parameters, field)
        value = base * (1.0 + deviation.fraction)
        if base == 0.0:
            example = show(quantity.upper, quantity.unit)
            item.refuse("is a share of zero", f"give the value itself, at most {example}")
            return None
        for limit, beyond in ((quantity.upper, "above"), (quantity.lower, "below")):
            if (value - limit) * (1.0 if beyond == "above" else -1.0) > 0.0:
                text = f"gives {show(value, quantity.unit)}, {beyond} {show(limit, quantity.unit)}"
                item.refuse(text, f"deviate less from {show(base, quantity.unit)}")
                return None
        return float(value)


def _check_together(model: Model, item: Located, changed: set[str]) -> None:
    """Record a problem for each pair of contradicting parameters of which one is in `changed`.

    The stroke must end above its beginning, the supply pressure be above the return pressure, and
    the stiction not be below the Coulomb friction.
    """
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
        section = "parameters" if item.find("parameters", field).name == field else "effects"
        value, limit = (show(getattr(par, name), unit) for name in (field, other))
        relation = "is below" if field == larger else "is above"
        remedy = f"correct {field} or {other}"
        item.find(section).refuse(f"{relation} {other} ({limit})", remedy, value, field)


def named_model(root: Located) -> Located:
    """Return the value of a file's key `model`, the name or path of a model.

    If the file does not have the key, the result is a value `nominal` at the place of `root`.
    """
    return root.get("model") or replace(root, value="nominal", name="model")


def load_model(reference: str | Path, base: Path | None = None) -> Model:
    """Return the model that a path or a name means, with what it takes over from its parents.

    `base` is the folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file and its parents.
    """
    return load("model", reference, base, read_model)
