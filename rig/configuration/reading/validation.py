"""YAML is validated here with pydantic, and every problem gets its line and column."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationError, create_model

from .document import Located
from .problems import nearest, suggestion
from .quantities import QuantityError


class Schema(BaseModel):
    """The base class of schemas, each of which describes one mapping of a configuration file.

    Mappings within it are checked by schemas of their own.
    """

    model_config = ConfigDict(coerce_numbers_to_str=True, arbitrary_types_allowed=True)


@dataclass(frozen=True)
class Under:
    """An annotation of a key under which a reader of its own reads other mappings.

    It changes nothing of how a file is read; editors are told by it what may stand there.

    Attributes:
        schemas: returns the classes of keys, one of which the mapping has.
        many: whether there is a list of such mappings.
        or_one: whether one mapping may stand in place of a list of one.
        named: whether the mappings stand under names of their own.
        names: the names that are allowed; empty for any.
        words: words that may stand in place of the mapping.
        text: whether any text may, such as the name of a file.
        optional: whether keys that are required elsewhere may be left out here.
    """

    schemas: Callable[[], tuple[type[Schema], ...]]
    many: bool = False
    or_one: bool = False
    named: bool = False
    names: tuple[str, ...] = ()
    words: tuple[str, ...] = ()
    text: bool = False
    optional: bool = False


S = TypeVar("S", bound=Schema)
T = TypeVar("T")


def read_mapping(
    schema: type[S], item: Located | None, hints: Mapping[str, str] | None = None
) -> S | None:
    """Return a mapping validated by its schema; record the problems.

    Problems are unknown keys, wrong values, and missing keys that are required. A key with a wrong
    or no value counts as absent, so that it has its default. Return None if a required key is wrong
    or missing, if the value is no mapping, or if `item` is None. `hints` gives the remedy for keys
    that belong somewhere else.
    """
    if item is None:
        return None
    if not isinstance(item.value, dict):
        item.refuse("is not a mapping", f"keys: {', '.join(schema.model_fields)}")
        return None
    data = {}
    for key, entry in item.items():
        if key not in schema.model_fields:
            remedy = (hints or {}).get(key) or suggestion(key, list(schema.model_fields), "keys")
            item.refuse("is not a known key", remedy, "", key)
        elif entry.value is not None:
            data[key] = entry.plain()
    try:
        return schema.model_validate(data)
    except ValidationError as error:
        bad = {str(detail["loc"][0]) for detail in error.errors() if detail["loc"]}
        for detail in error.errors():
            _add(schema, item, dict(detail))
    try:
        return schema.model_validate({key: data[key] for key in data if key not in bad})
    except ValidationError:
        return None


def checked(
    item: Located, fields: Mapping[str, Any], hints: Mapping[str, str] | None = None
) -> dict[str, Any]:
    """Return key -> value for all keys of `fields`; the value is None where absent or wrong.

    `fields` gives the type of each key's value, `hints` the remedy for misplaced keys. Mistakes are
    recorded as problems, keys that are not in `fields` among them.
    """
    file = read_mapping(_section(tuple(fields.items())), item, hints)
    return {key: getattr(file, key, None) for key in fields}


@lru_cache(maxsize=64)
def _section(fields: tuple[tuple[str, Any], ...]) -> type[Schema]:
    """Return a schema with these keys, each with the type of its value, all of which may be absent.

    Making a schema with all parameters of a plant takes as long as reading a whole campaign file,
    and each file of a model needs the same one. So the last 64 are kept, which is more than the
    shipped files need; the types must be hashable.
    """
    definitions: dict[str, Any] = {key: (kind, None) for key, kind in fields}
    return create_model("Section", __base__=Schema, **definitions)


def elements_of(item: Located | None, remedy: str) -> list[Located]:
    """Return the elements of a list; [] for None; if it is no list, add a problem and return []."""
    if item is not None and not isinstance(item.value, list):
        item.refuse("is not a list", remedy)
    return [] if item is None else item.elements()


def refuse_missing(item: Located, key: str, known: Iterable[str]) -> None:
    """Record that a mapping lacks a key, unless another of its keys is a misspelling of this one.

    A misspelt key is reported with this name as remedy. A key whose value could not be read is not
    lacking: that is reported already. `known` are the keys that may be written.
    """
    problems = item.sources.problems
    written = item.value.get(key) if isinstance(item.value, dict) else None
    if written is not None and problems.has_at(written.place, key):
        problems.reported += 1
        return
    known = set(known)
    unknown = [given for given, _ in item.items() if given not in known]
    if nearest(key, unknown) is None:
        item.refuse(f"lacks the key {key}", f"add `{key}: ...`", "")


def quantity_in(item: Located, read: Callable[[], T]) -> T | None:
    """Return the result of `read`; if it raises `QuantityError`, add a problem, return None.

    The problem is placed at `item`, the value that `read` reads.
    """
    try:
        return read()
    except QuantityError as error:
        item.refuse(error.limit, error.remedy)
        return None


def _add(schema: type[Schema], item: Located, detail: dict[str, Any]) -> None:
    location = tuple(step for step in detail["loc"] if isinstance(step, str | int))
    name = str(location[0]) if location else item.name
    if detail["type"] == "missing":
        refuse_missing(item, name, schema.model_fields)
        return
    found = item.find(*location)
    if detail["type"] == "quantity":
        found.refuse(detail["ctx"]["limit"], detail["ctx"]["remedy"])
        return
    choices = _choices(schema.model_fields[name].annotation) if name in schema.model_fields else []
    if detail["type"] in ("literal_error", "enum") and choices:
        near = nearest(str(found.value), choices)
        remedy = f"did you mean {near}?" if near else f"choose one of {', '.join(choices)}"
        found.refuse("is not a choice here", remedy)
        return
    message = str(detail["msg"]).removeprefix("Input ").removeprefix("Value error, ")
    found.refuse(message[0].lower() + message[1:])


def _choices(annotation: object) -> list[str]:
    if get_origin(annotation) is Literal:
        return [str(choice) for choice in get_args(annotation)]
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return [str(choice.value) for choice in annotation]
    return [choice for part in get_args(annotation) for choice in _choices(part)]
