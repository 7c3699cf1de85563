"""A test matrix lets a test be written once for every combination of the values of its axes."""

import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from math import prod
from typing import Final, NamedTuple

from .document import Located
from .problems import suggestion

_REFERENCE: Final = re.compile(r"\$\{\s*([^}]*?)\s*\}")
MAX_TESTS: Final = 10_000


class Choice(NamedTuple):
    """One value of an axis, and the label that is written in its place in tests' names."""

    label: str
    value: Located


def expand(test: Located) -> list[Located]:
    """Return copies of a test without its matrix: one for each combination of the axes' values.

    In a copy, an entry `${axis}` is replaced by the axis's value, which may be a list or a mapping,
    with its place in the file. Within a longer text, `${axis}` is replaced by the value's text, and
    in `name` by its label. A test without a matrix gives one copy; more than `MAX_TESTS`
    combinations give none. Problems are recorded; an axis without usable values is left out.
    """
    matrix = test.get("matrix")
    axes = _read_axes(matrix) if matrix is not None else {}
    body = test.with_value({key: entry for key, entry in test.items() if key != "matrix"})
    count = prod(map(len, axes.values()))
    if matrix is not None and count > MAX_TESTS:
        matrix.refuse(f"is above {MAX_TESTS}", "split the campaign", f"{count} tests")
        return []
    combinations = product(*axes.values())
    return [_substituted(body, dict(zip(axes, choices, strict=True))) for choices in combinations]


def _read_axes(matrix: Located) -> dict[str, list[Choice]]:
    if not isinstance(matrix.value, dict):
        matrix.refuse("is not a mapping", "write `axis: [values]` or `axis: {label: value}`")
    axes = {}
    for name, axis in matrix.items():
        choices = list(_read_choices(axis))
        if choices:
            axes[name] = choices
        elif not axis.elements():
            axis.refuse("has no values", "write a list of values, or a mapping of labels to values")
    return axes


def _read_choices(axis: Located) -> Iterator[Choice]:
    for label, value in axis.items():
        yield Choice(label, value)
    for value in axis.elements():
        if isinstance(value.value, dict | list):
            value.refuse("has no label", f"write {axis.name} as a mapping of labels to values")
        else:
            yield Choice(str(value.value), value)


def _substituted(item: Located, chosen: dict[str, Choice]) -> Located:
    if isinstance(item.value, dict):
        return item.with_value({key: _substituted(each, chosen) for key, each in item.items()})
    if isinstance(item.value, list):
        return item.with_value([_substituted(element, chosen) for element in item.value])
    if not isinstance(item.value, str):
        return item
    whole = _REFERENCE.fullmatch(item.value.strip())
    if whole and whole[1] in chosen and item.name != "name":
        return replace(chosen[whole[1]].value, name=item.name)

    def text(match: re.Match[str]) -> str:
        choice = chosen.get(match[1])
        if choice is None:
            remedy = suggestion(match[1], list(chosen), "axes")
            item.refuse("is no axis of the matrix", remedy, match[0])
            return match[1]
        if item.name == "name":
            return choice.label
        if isinstance(choice.value.value, dict | list):
            remedy = f"let ${{{match[1]}}} stand alone"
            item.refuse("is a structure within a text", remedy, match[0])
            return match[1]
        return str(choice.value.value)

    return item.with_value(_REFERENCE.sub(text, item.value))
