"""Models are written here to files that load back to the identical floats.

Each value has its symbol and source in a comment.
"""

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
import yaml

from rig.configuration.reading import ConfigError, Problem, QuantityError, display_path
from rig.plant import CATALOGUE, FRICTION_LAWS, NOMINAL, Model, quantities
from rig.recording import replacing

from .discovered import written_terms
from .model import PARAMETERS, physical

_QUANTITIES: Final = quantities()
_COMMENT_COLUMN: Final = 48


def dump_model(model: Model, path: Path) -> None:
    """Write a model to a file from which the identical model is read, and replace an older file.

    An effect whose parameters are not neutral is written as switched on, even if the model does not
    list it; provenance is written as `plain_provenance` returns it. The file is replaced in one
    step: after an error the old one, if any, is unchanged.

    Raises:
        ConfigError: a parameter is outside the range that a model file may hold.
        OSError: the file cannot be written.
    """
    _require_loadable(model, path)
    parts = (_header, _sections, written_terms, _provenance)
    text = "\n".join(line for part in parts for line in part(model))
    with replacing(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        # Everybody may read a model, whatever else this user's files are.
        temporary.chmod(0o644)
        file.write(text + "\n")
        file.flush()
        os.fsync(file.fileno())


def _quantity(field: str, value: float) -> str:
    return f"{float(value)!r} {_QUANTITIES[field].unit}".strip()


def _require_loadable(model: Model, path: Path) -> None:
    problems = []
    for field in _QUANTITIES:
        value = getattr(model.parameters, field)
        if field == "friction_law":
            if value not in FRICTION_LAWS.values():
                choices = ", ".join(FRICTION_LAWS)
                problems.append((field, str(value), "is no friction law", f"use {choices}"))
            continue
        try:
            physical(field).parse(_quantity(field, value))
        except QuantityError as error:
            problems.append((field, _quantity(field, value), error.limit, error.remedy))
    if problems:
        raise ConfigError(Problem(display_path(path), 0, 0, *problem) for problem in problems)


def _header(model: Model) -> Iterator[str]:
    yield yaml.safe_dump({"name": model.name}).strip()
    law = next(name for name, v in FRICTION_LAWS.items() if v == model.parameters.friction_law)
    yield f"friction_law: {law}"


def _sections(model: Model) -> Iterator[str]:
    def line(key: str, field: str) -> str:
        quantity = _QUANTITIES[field]
        comment = ", ".join(part for part in (quantity.symbol, quantity.source) if part)
        return commented(f"{key}: {_quantity(field, getattr(model.parameters, field))}", comment)

    switched_on = [CATALOGUE[name] for name in _switched_on(model)]
    keys = {effect.name: {p.name: p.field for p in effect.parameters} for effect in switched_on}
    return section_lines(PARAMETERS, keys, line)


def section_lines(
    own: Iterable[str], effects: Mapping[str, Mapping[str, str]], line: Callable[[str, str], str]
) -> Iterator[str]:
    """Yield the lines of the sections `parameters` and `effects` of a model file.

    Args:
        own: names of the parameters that stand under `parameters`, unless they belong to one of the
            effects.
        effects: effect that is switched on -> key in the file -> name of a parameter.
        line: makes the line of a parameter from its key, indented, and its name.
    """
    under_effects = {name for keys in effects.values() for name in keys.values()}
    yield "parameters:"
    yield from (line(f"  {name}", name) for name in own if name not in under_effects)
    if effects:
        yield "effects:"
    for effect, keys in effects.items():
        if list(keys) == ["value"]:
            yield line(f"  {effect}", keys["value"])
            continue
        yield f"  {effect}:"
        yield from (line(f"    {key}", name) for key, name in keys.items())


def commented(text: str, comment: str) -> str:
    """Return a line of a model file with a comment after it, or the line alone if that is empty."""
    return f"{text:<{_COMMENT_COLUMN}} # {comment}" if comment else text


def _switched_on(model: Model) -> list[str]:
    """Return the names of the model's effects, and of all others that act by their parameters.

    Those have a parameter that is not neutral; one that an effect only shifts does not count.
    """
    acting = [
        effect.name
        for effect in CATALOGUE.values()
        if effect.name not in model.effects
        and any(
            getattr(model.parameters, p.field) != getattr(NOMINAL, p.field)
            for p in effect.parameters
            if not p.shift
        )
    ]
    return [*model.effects, *acting]


def _provenance(model: Model) -> Iterator[str]:
    if model.provenance:
        plain = {"provenance": plain_provenance(model.provenance)}
        yield yaml.safe_dump(plain, sort_keys=False).rstrip()


def plain_provenance(value: Any) -> Any:
    """Return provenance as dicts, lists and scalars that YAML can hold.

    Arrays, tuples and sets become lists; any other object becomes its text.
    """
    if isinstance(value, Mapping):
        return {str(key): plain_provenance(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain_provenance(value.tolist())
    if isinstance(value, list | tuple | set | frozenset):
        return [plain_provenance(item) for item in value]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    return str(value)
