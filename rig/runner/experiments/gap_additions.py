"""Converts what the gap workflow adds to a model between its slots and the terms of a model file."""

from collections.abc import Mapping, Sequence
from typing import Final

from estimator.gap import Addition, Plant, servo_actuator
from rig.configuration import addition_of, term_of
from rig.plant import (
    MOST_TABLES,
    MOST_TERMS,
    AddedTerm,
    Model,
    Parameters,
    fields_of,
    is_held,
    terms_of,
)

_FRICTION: Final = "friction level"
_FORCE: Final = "force balance"


def slots_of(plant: Plant, terms: Sequence[AddedTerm]) -> dict[str, float]:
    """Return the values of a plant's slots that hold terms which the rig's parameters cannot hold.

    Terms that the slots cannot hold either are left out.
    """
    layout = plant.layout
    if layout is None:
        return {}
    additions = [addition_of(term) for term in terms]
    return layout.values([each for each in additions if not layout.why_not(each)])


def with_terms(values: Mapping[str, float]) -> tuple[Parameters, tuple[AddedTerm, ...]]:
    """Return the rig's parameters with all terms that they can hold, and the other terms.

    Args:
        values: values of all parameters of the workflow's plant, by name.
    """
    parameters = Parameters(**{field: values[field] for field in Parameters._fields})
    layout = servo_actuator(Model()).layout
    assert layout is not None
    held = list(terms_of(parameters))
    others: list[AddedTerm] = []
    for addition in layout.additions(values):
        term = _term(addition)
        tables = sum(each.form == "table" for each in held)
        room = len(held) < MOST_TERMS and (term.form != "table" or tables < MOST_TABLES)
        if is_held(term) and room:
            held.append(term)
        else:
            others.append(_term(addition, held=False))
    return parameters._replace(**fields_of(tuple(held))), tuple(others)


def _term(addition: Addition, *, held: bool = True) -> AddedTerm:
    """Return an addition as a term; with `held`, friction as a force that opposes the motion."""
    term = term_of(addition)
    if held and term.place == _FRICTION and not term.turned:
        return term._replace(place=_FORCE, turned=True)
    return term
