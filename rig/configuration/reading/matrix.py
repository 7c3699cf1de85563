"""A test matrix lets a test be written once for every combination of the values of its axes."""

import re
from collections.abc import Iterator
from itertools import product
from typing import Final, NamedTuple

from .document import Located
from .problems import Problems, suggestion
from .validation import shown

_REFERENCE: Final = re.compile(r"\$\{\s*([^}]*?)\s*\}")
MAX_TESTS: Final = 10_000


class Choice(NamedTuple):
    """One value of an axis, and the label that stands for it in tests' names."""

    label: str
    value: Located


def expand(test: Located, problems: Problems) -> list[Located]:
    """Return a copy of the test, without its matrix, for every combination of the matrix's axes.

    A value `${axis}` is replaced by the axis's value, which may be a list or a mapping, with its
    place in the file. Within a longer text, `${axis}` is replaced by the value's text, and in
    `name` by its label. [] if there are more than `MAX_TESTS` combinations. A test without a matrix
    is returned once. Problems are recorded; an axis without usable values is left out.
    """
    matrix = test.get("matrix")
    axes = _read_axes(matrix, problems) if matrix is not None else {}
    entries = {key: entry for key, entry in test.items() if key != "matrix"}
    body = Located(entries, test.place, test.name)
    if not _is_affordable(axes, matrix, problems):
        return []
    return [
        _substituted(body, dict(zip(axes, choices, strict=True)), problems)
        for choices in product(*axes.values())
    ]


def _is_affordable(
    axes: dict[str, list[Choice]], matrix: Located | None, problems: Problems
) -> bool:
    count = 1
    for choices in axes.values():
        count *= len(choices)
    if matrix is not None and count > MAX_TESTS:
        remedy = "split the campaign"
        problems.add(matrix.place, "matrix", f"{count} tests", f"is above {MAX_TESTS}", remedy)
        return False
    return True


def _read_axes(matrix: Located, problems: Problems) -> dict[str, list[Choice]]:
    if not isinstance(matrix.value, dict):
        remedy = "write `axis: [values]` or `axis: {label: value}`"
        problems.add(matrix.place, "matrix", shown(matrix), "is not a mapping", remedy)
        return {}
    axes = {}
    for name, axis in matrix.items():
        choices = list(_read_choices(axis, problems))
        if choices:
            axes[name] = choices
        elif not axis.elements():
            remedy = "write a list of values, or a mapping of labels to values"
            problems.add(axis.place, name, shown(axis), "has no values", remedy)
    return axes


def _read_choices(axis: Located, problems: Problems) -> Iterator[Choice]:
    for label, value in axis.items():
        yield Choice(label, value)
    for value in axis.elements():
        if isinstance(value.value, dict | list):
            remedy = f"write {axis.name} as a mapping of labels to values"
            problems.add(value.place, value.name, shown(value), "has no label", remedy)
        else:
            yield Choice(str(value.value), value)


def _substituted(item: Located, chosen: dict[str, Choice], problems: Problems) -> Located:
    if isinstance(item.value, dict):
        entries = {key: _substituted(e, chosen, problems) for key, e in item.items()}
        return Located(entries, item.place, item.name)
    if isinstance(item.value, list):
        elements = [_substituted(element, chosen, problems) for element in item.value]
        return Located(elements, item.place, item.name)
    if not isinstance(item.value, str):
        return item
    whole = _REFERENCE.fullmatch(item.value.strip())
    if whole and whole[1] in chosen and item.name != "name":
        value = chosen[whole[1]].value
        return Located(value.value, value.place, item.name)

    def text(match: re.Match[str]) -> str:
        choice = chosen.get(match[1])
        if choice is None:
            remedy = suggestion(match[1], list(chosen), "axes")
            problems.add(item.place, item.name, match[0], "is no axis of the matrix", remedy)
            return match[1]
        if item.name == "name":
            return choice.label
        if isinstance(choice.value.value, dict | list):
            remedy = f"let ${{{match[1]}}} stand alone"
            problems.add(item.place, item.name, match[0], "is a structure within a text", remedy)
            return match[1]
        return str(choice.value.value)

    return Located(_REFERENCE.sub(text, item.value), item.place, item.name)
