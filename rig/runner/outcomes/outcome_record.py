"""Converts the outcome of a test to plain values for JSON, and such values back to the outcome.

The journal keeps outcomes in this form.
"""

import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite
from typing import Any, Final, Union, get_args, get_origin, get_type_hints

import numpy as np

from .outcome import TestOutcome


def record_of(outcome: TestOutcome) -> dict[str, Any]:
    """Return an outcome as JSON-able values, from which `outcome_of` can make it again.

    Floats stay exact; NaN and infinity become text.
    """
    return dict(jsonable(outcome, repr))


def outcome_of(record: Mapping[str, Any]) -> TestOutcome:
    """Return the outcome from which `record_of` made a record.

    Raises:
        ValueError: the record is not that of an outcome.
    """
    try:
        outcome: TestOutcome = _made(TestOutcome, record)
    except (TypeError, KeyError, AttributeError, OverflowError, RecursionError) as error:
        raise ValueError(f"no outcome of a test: {error}") from None
    return outcome


def named(source: object, *names: str, **renamed: str) -> dict[str, Any]:
    """Return attributes of an object, some under their own names and others under other keys.

    Args:
        source: the object; if it is None, all values are None.
        names: names of attributes, which are also their keys.
        renamed: names of further attributes, by their keys.
    """
    keys = {name: name for name in names} | renamed
    return {key: None if source is None else getattr(source, name) for key, name in keys.items()}


def jsonable(value: Any, lacking: Callable[[float], str | None] = lambda number: None) -> Any:
    """Return a value with its dataclasses, arrays, mappings and sequences as JSON has them.

    A dataclass becomes a dict, an array, list or tuple a list, and a member of an Enum its value.
    Values of other types stay as they are.

    Args:
        value: the value.
        lacking: returns what stands for NaN and infinity, which JSON lacks; None if not given.
    """
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value) and not isinstance(value, type):
        found = {field.name: getattr(value, field.name) for field in fields(value)}
        return jsonable(found, lacking)
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist(), lacking)
    if isinstance(value, Mapping):
        return {str(key): jsonable(item, lacking) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item, lacking) for item in value]
    if isinstance(value, float):
        return float(value) if isfinite(value) else lacking(float(value))
    return value


_hints: Final = cache(get_type_hints)


def _made(kind: Any, value: Any) -> Any:
    """Return a JSON value as an object of the type `kind`; the values in it are converted, too.

    A union has one type and None: None stays None, and another value is converted to the type.
    """
    origin, arguments = get_origin(kind), get_args(kind)
    if origin in (Union, types.UnionType):
        if value is None:
            return None
        (kind,) = (each for each in arguments if each is not type(None))
        return _made(kind, value)
    if origin is tuple:
        kinds = [arguments[0]] * len(value) if arguments[1:] == (...,) else arguments
        return tuple(_made(each, item) for each, item in zip(kinds, value, strict=True))
    if origin is np.ndarray:
        return np.array(value, dtype=np.float64)
    if origin is not None and issubclass(origin, Mapping):
        return {key: _made(arguments[1], item) for key, item in value.items()}
    if isinstance(kind, type) and is_dataclass(kind):
        hints = _hints(kind)
        return kind(**{name: _made(hints[name], item) for name, item in value.items()})
    if isinstance(kind, type) and issubclass(kind, tuple):
        return kind(*value)
    return kind(value) if isinstance(kind, type) else value
