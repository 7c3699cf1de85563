"""This module says how a model of the servo-actuator holds additions.

The rig's own equations hold as many as its parameters have room for (`rig.plant.added_terms`).
There they act at every moment, in simulations and filters too. Readings, parameters that change and
what depends on the time are held in slots.
"""

from collections.abc import Mapping, Sequence
from typing import Final

from estimator.gap.plant import DIRECTION, TIME_NAME, Addition, Layout
from rig.plant import MOST_TABLES, MOST_TERMS, AddedTerm, Parameters, fields_of, is_held, terms_of

FRICTION: Final = "friction level"
_FORCE: Final = "force balance"
_COUNTS: Final = {"wave": 2, "bump": 2, "hinge": 1}
_PARTS: Final = ("size", "at", "by")


class ServoLayout(Layout):
    """Translates additions to the rig's terms and to slots, and back."""

    def _placed(self, additions: Sequence[Addition]) -> tuple[list[int], list[int]]:
        """Return the indices of the additions that are terms, in their order, and of the others."""
        tables: list[int] = []
        symbols: list[int] = []
        others: list[int] = []
        for index, each in enumerate(additions):
            room = len(tables) + len(symbols) < MOST_TERMS
            if not (is_held(term_of(each)) and room):
                others.append(index)
            elif each.form != "table":
                symbols.append(index)
            elif len(tables) < MOST_TABLES:
                tables.append(index)
            else:
                others.append(index)
        return [*tables, *symbols], others

    def values(self, additions: Sequence[Addition]) -> dict[str, float]:
        """Return the values of the fields of all terms and slots, by parameter name.

        Raises:
            ValueError: there are more additions than there is room for, or one cannot be held.
        """
        terms, others = self._placed(additions)
        return {
            **fields_of(tuple(term_of(additions[k]) for k in terms)),
            **super().values([additions[k] for k in others]),
        }

    def additions(self, values: Mapping[str, float]) -> list[Addition]:
        """Return the additions that the values of all parameters hold: terms, then slots."""
        parameters = Parameters(**{field: values[field] for field in Parameters._fields})
        terms = [addition_of(term) for term in terms_of(parameters)]
        return [*terms, *super().additions(values)]

    def names(self, additions: Sequence[Addition], index: int) -> tuple[list[str], list[str]]:
        """Return the names of the parameters that hold the values, and the places, of an addition.

        The additions are those given to `values`; `index` is that of one of them.
        """
        terms, others = self._placed(additions)
        each = additions[index]
        if index not in terms:
            return super().names([additions[k] for k in others], others.index(index))
        number = 1 + terms.index(index)
        if each.form == "table":
            knots = range(1, len(each.at) + 1)
            return (
                [f"table_{number}_value_{k}" for k in knots],
                [f"table_{number}_at_{k}" for k in knots],
            )
        at = [f"term_{number}_{part}" for part in _PARTS[1 : 1 + len(each.at)]]
        return [f"term_{number}_size"], at


def term_of(addition: Addition) -> AddedTerm:
    """Return an addition as a term of a rig's model file.

    Friction is a force that opposes the motion, which the rig adds to the level of its bristles.
    """
    term = as_term(addition)
    if term.place == FRICTION and not term.turned and term.of != TIME_NAME:
        return term._replace(place=_FORCE, turned=True)
    return term


def addition_of(term: AddedTerm) -> Addition:
    """Return a term of a rig's model file as an addition; the inverse of `term_of`."""
    if term.place == _FORCE and term.turned:
        term = term._replace(place=FRICTION, turned=False)
    return as_addition(term)


def as_term(addition: Addition) -> AddedTerm:
    """Return an addition as a term of a model file, at its own place."""
    turned = addition.times == DIRECTION
    form = "1" if addition.form == "constant" else addition.form
    if form == "table":
        knots = tuple(zip(addition.at, addition.values, strict=True))
        return AddedTerm(addition.place, addition.of, form, turned, 1.0, knots=knots)
    at, by = (*addition.at, 0.0, 0.0)[:2]
    return AddedTerm(addition.place, addition.of, form, turned, addition.values[0], at, by)


def as_addition(term: AddedTerm) -> Addition:
    """Return a term of a model file as an addition; the inverse of `as_term`."""
    times = DIRECTION if term.turned else ""
    if term.form == "table":
        at, values = zip(*term.knots, strict=True)
        scaled = tuple(term.size * value for value in values)
        return Addition(term.place, term.of, times, "table", at, scaled)
    form = "constant" if term.form == "1" else term.form
    at = (term.at, term.by)[: _COUNTS.get(form, 0)]
    return Addition(term.place, term.of, times, form, at, (term.size,))
